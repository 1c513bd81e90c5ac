//! Probability maps drawn by formulas, for tests.

use super::{Class, Plane, ProbabilityMaps};

pub(super) const WIDTH: usize = 400;
pub(super) const HEIGHT: usize = 240;

/// Draws what has the value `probability(u, v)` over what is there.
pub(super) fn draw(maps: &mut ProbabilityMaps, class: Class, probability: impl Fn(f64, f64) -> f64) {
    let old = maps.plane(class);
    let data = old.data().iter().enumerate().map(|(i, &old)| {
        let value = probability((i % WIDTH) as f64, (i / WIDTH) as f64);
        old.max((255.0 * value + 0.5) as u8)
    });
    let plane = Plane::new(WIDTH, data.collect()).unwrap();
    maps.set(class, plane).unwrap();
}

pub(super) fn empty() -> ProbabilityMaps {
    ProbabilityMaps::zeros(WIDTH, HEIGHT)
}

/// An anti-aliased bar of this width around a segment, its ends square.
pub(super) fn bar(a: (f64, f64), b: (f64, f64), width: f64) -> impl Fn(f64, f64) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length = dx.hypot(dy);
    let (dx, dy) = (dx / length, dy / length);
    move |u, v| {
        let along = (u - a.0) * dx + (v - a.1) * dy;
        let across = (u - a.0) * dy - (v - a.1) * dx;
        let side = (0.5 * width + 0.5 - across.abs()).clamp(0.0, 1.0);
        side * (along + 0.5).clamp(0.0, 1.0) * (length + 0.5 - along).clamp(0.0, 1.0)
    }
}
