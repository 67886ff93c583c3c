//! `treeline bench`, the half that measures nothing: rows in; tables, plots, a report and comparisons out.

mod compare_runs;
mod format;
mod plot;
mod report;
mod row;
#[cfg(test)]
mod sample;
mod scenario;
mod stats;
mod table;
