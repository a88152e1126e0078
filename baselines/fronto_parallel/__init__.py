"""The fronto-parallel method: distortion, Hough and correlation for balls, Canny and band Hough for the nail.

"The paper" is L. Joskowicz, C. Milgrom, M. Shoham, Z. Yaniv, A. Simkin, *A robot-assisted system for long bone
intramedullary distal locking: concept and preliminary results*, Computer Assisted Radiology and Surgery, 2003. Its
sequel: Z. Yaniv, L. Joskowicz, *Precise robot-assisted guide positioning for distal locking of intramedullary nails*,
IEEE Transactions on Medical Imaging 24(5), 2005.
"""
