//! CPU twin of the peeler.
