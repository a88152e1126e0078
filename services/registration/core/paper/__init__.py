"""The paper's method, complete: distortion, Hough and correlation for balls, Canny and band Hough for the nail."""
