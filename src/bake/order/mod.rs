//! Progressive orders.
