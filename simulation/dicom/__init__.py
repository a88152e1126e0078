"""The C-arm as a DICOM modality: its images and how they are sent."""
