#[cfg_attr(not(test), expect(dead_code, reason = "its command comes with the tool"))]
mod flip;
mod font;
#[cfg_attr(not(test), expect(dead_code, reason = "its command comes with the tool"))]
mod sheet;

fn main() {}
