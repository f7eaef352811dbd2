//! Prepared maps for winze: everything that is done once for a prior map, in one file.
