//! Frame times of the last seconds, and their graph.

use bevy::prelude::*;
use bevy_egui::egui;
use std::collections::VecDeque;

/// Frames kept.
const KEPT: usize = 240;

/// Frame times in milliseconds, oldest first.
#[derive(Resource, Default)]
pub struct FrameTimes(VecDeque<f32>);

impl FrameTimes {
    /// Adds a frame.
    pub fn push(&mut self, milliseconds: f32) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(milliseconds);
    }

    /// Median and worst of what is kept.
    pub fn median_and_worst(&self) -> (f32, f32) {
        let mut sorted: Vec<f32> = self.0.iter().copied().collect();
        sorted.sort_by(f32::total_cmp);
        let at = |i: usize| sorted.get(i).copied().unwrap_or(0.0);
        (at(sorted.len() / 2), at(sorted.len().saturating_sub(1)))
    }

    /// Draws the graph: a bar a frame, lines at 60 and 30 frames a second.
    pub fn show(&self, ui: &mut egui::Ui) {
        let (median, worst) = self.median_and_worst();
        ui.label(format!(
            "{median:.1} ms a frame ({:.0} fps), worst {worst:.1} ms",
            1000.0 / median.max(1e-3)
        ));
        let size = egui::vec2(ui.available_width().max(60.0), 60.0);
        let (response, painter) = ui.allocate_painter(size, egui::Sense::hover());
        let area = response.rect;
        painter.rect_filled(area, 2.0, egui::Color32::from_black_alpha(110));
        let highest = (worst * 1.1).max(20.0);
        let y = |ms: f32| area.bottom() - area.height() * (ms / highest).min(1.0);
        let width = area.width() / KEPT as f32;
        for (i, &ms) in self.0.iter().enumerate() {
            let left = area.left() + i as f32 * width;
            let color = match ms {
                ms if ms <= 17.0 => egui::Color32::from_rgb(110, 190, 110),
                ms if ms <= 34.0 => egui::Color32::from_rgb(220, 190, 90),
                _ => egui::Color32::from_rgb(220, 110, 90),
            };
            let bar = egui::Rect::from_min_max(
                egui::pos2(left, y(ms)),
                egui::pos2(left + width.max(1.0), area.bottom()),
            );
            painter.rect_filled(bar, 0.0, color);
        }
        for ms in [1000.0 / 60.0, 1000.0 / 30.0] {
            if ms < highest {
                let line = egui::Stroke::new(1.0, egui::Color32::from_white_alpha(90));
                painter.hline(area.x_range(), y(ms), line);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_frames_leave_and_the_worst_is_found() {
        let mut times = FrameTimes::default();
        times.push(900.0);
        for i in 0..KEPT {
            times.push(10.0 + i as f32 / KEPT as f32);
        }
        let (median, worst) = times.median_and_worst();
        assert!((10.4..10.6).contains(&median) && worst < 11.0, "{median} {worst}");
    }
}
