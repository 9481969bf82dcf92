"""Marker detection by OpenCV: grey image -> marker numbers and corners.

OpenCV comes with the extra `markers`.

S. Garrido-Jurado et al. Automatic generation and detection of highly reliable fiducial markers
under occlusion. Pattern Recognition 47(6), 2280-2292, 2014.
"""

from functools import cache
from typing import Any

import numpy as np

from rastercov.base import ByteArray, DeviceError, FloatArray
from rastercov.reference.markers.scene import CELLS

MIN_PERIMETER = 128.0
"""P_min of the thesis, px of contour."""


@cache
def opencv() -> Any:
    """The module cv2; DeviceError with the package to install where it is missing."""
    try:
        import cv2
    except ImportError as error:
        raise DeviceError(
            f"expected OpenCV, got none ({error}); pip install 'rastercov[markers]'"
        ) from None
    if not hasattr(cv2, "aruco") or not hasattr(cv2.aruco, "ArucoDetector"):
        raise DeviceError(
            f"expected OpenCV 4.7 or newer, which detects markers, got {cv2.__version__}; pip "
            "install -U opencv-python-headless"
        )
    return cv2


def dictionary() -> Any:
    """OpenCV's DICT_6X6_250."""
    cv2 = opencv()
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)


def patterns() -> ByteArray:
    """Cells of all markers, (250, 8, 8): 1 is white; the border is black."""
    cv2, known = opencv(), dictionary()
    count = len(known.bytesList)
    images = [cv2.aruco.generateImageMarker(known, number, CELLS) for number in range(count)]
    return (np.stack(images) > 127).astype(np.uint8)


def detect(image: ByteArray, min_perimeter: float = MIN_PERIMETER) -> dict[int, FloatArray]:
    """Markers found in a picture, (H, W): number -> corners (4, 2), clockwise from the top left.

    `min_perimeter` is the least number of contour points; the detector's other settings are
    OpenCV's defaults.
    """
    cv2 = opencv()
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = min_perimeter / max(image.shape)
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary(), settings).detectMarkers(image)
    if numbers is None:
        return {}
    # (N, 1) up to OpenCV 4, (N,) from 5 on. OpenCV counts from pixel centres.
    values = np.ravel(numbers)
    return {
        int(number): np.reshape(corner, (4, 2)).astype(np.float64) + 0.5
        for number, corner in zip(values, corners, strict=True)
    }
