"""Marker validation: whether the model foretells what a detector finds in pictures.

    plates -> mesh -> engine  -> predicted
           -> picture -> OpenCV -> found

Beside the chain: nothing in it imports this. docs/markers.md has the results.
"""
