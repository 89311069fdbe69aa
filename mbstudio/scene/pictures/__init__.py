"""Pictures and animations of scenes, drawn off screen: figures of grains, thumbnails, morphs."""
