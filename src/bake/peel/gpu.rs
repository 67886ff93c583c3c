//! GPU peeler.
