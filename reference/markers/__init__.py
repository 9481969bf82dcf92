"""Marker validation: predictions of the model against detections of OpenCV in pictures.

    plates -> mesh -> engine  -> predicted
           -> picture -> OpenCV -> found

docs/appendix/markers.md has the results.
"""
