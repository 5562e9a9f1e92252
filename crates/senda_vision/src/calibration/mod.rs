//! Camera calibration from a printed sheet (C1, C2 in SPEC).
