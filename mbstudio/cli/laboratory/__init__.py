"""The commands of a laboratory: `grading`, `enough` and `porosity`. Begin at `grading`."""
