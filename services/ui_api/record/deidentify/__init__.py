"""A case without what identifies people: after the Basic Application Level Confidentiality Profile, DICOM PS3.15 E."""
