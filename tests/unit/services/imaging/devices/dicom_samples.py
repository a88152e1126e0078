"""DICOM files for tests."""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from pydicom import dcmread, dcmwrite
from pydicom.dataset import Dataset

from services.imaging.devices.dicom_file import dicom_of_pixels


def grey_ramp(rows: int = 6, columns: int = 8) -> NDArray[np.uint16]:
    """Values 0, 100, 200, ..."""
    return (100 * np.arange(rows * columns, dtype=np.uint16)).reshape(rows, columns)


def dataset_of(pixels: NDArray[np.uint16]) -> Dataset:
    """A plain object to be changed by a test."""
    return dcmread(BytesIO(dicom_of_pixels(pixels)[0]))


def file_of(dataset: Dataset) -> bytes:
    buffer = BytesIO()
    dcmwrite(buffer, dataset, enforce_file_format=True)
    return buffer.getvalue()
