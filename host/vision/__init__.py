"""Picture and mount in, `CropView` out."""

from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.view import CropView, Detector

__all__ = ["CropView", "Detector", "MountedDetector", "make_detector"]
