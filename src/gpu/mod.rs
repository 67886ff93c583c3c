//! L1: what GPU code of several places shares.

pub mod headless;
