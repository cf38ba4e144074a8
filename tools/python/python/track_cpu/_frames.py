"""Pictures from a video file (by OpenCV) or a folder (by OpenCV or Pillow), in the order BGR."""

import re
from pathlib import Path

import numpy as np

SUFFIXES = {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".webp"}


def read(path):
    """Yields the pictures of a video file or of a folder's images: arrays (H, W, 3) of uint8.

    Images come in natural order: img2 before img10.

    Raises OSError if there is nothing to read, ImportError without OpenCV (or Pillow, for images).
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    if path.is_dir():
        files = sorted((file for file in path.iterdir() if is_image(file)), key=natural)
        if not files:
            raise OSError(f"{path}: no images, expected {', '.join(sorted(SUFFIXES))}")
        for file in files:
            yield image(file)
        return
    if is_image(path):
        yield image(path)
        return
    yield from video(path)


def is_image(path):
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


def natural(path):
    """A key that sorts img2 before img10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts], path.name


def image(path):
    try:
        import cv2
    except ImportError:
        return pillow_image(path)
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise OSError(f"{path}: cannot be decoded")
    return picture


def pillow_image(path):
    try:
        from PIL import Image, ImageOps
    except ImportError as error:
        raise ImportError("reading images needs opencv-python or pillow") from error
    with Image.open(path) as file:
        return np.asarray(ImageOps.exif_transpose(file).convert("RGB"))[..., ::-1]


def video(path):
    try:
        import cv2
    except ImportError as error:
        raise ImportError("reading a video needs opencv-python; a folder of images does not") from error
    capture = cv2.VideoCapture(str(path))
    try:
        ok, picture = capture.read()
        if not ok:
            raise OSError(f"{path}: OpenCV reads no picture from it")
        while ok:
            yield picture
            ok, picture = capture.read()
    finally:
        capture.release()
