"""Station Packing: grains are poured into a mould, settle before one's eyes, and are measured.

`work` has them packed in the background, `looks` prepares what view and plots show. Begin at `station`.
"""
