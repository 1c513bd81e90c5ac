//! An image with what was found in it and what the map says should be there:
//! the picture to look at when a number surprises.

use nalgebra::{Point2, Vector2};

use crate::features::Features;
use crate::vision::RgbImage;

/// A landmark of the map in the image, pixels.
#[derive(Debug, Clone, PartialEq)]
pub enum ProjectedShape {
    /// A pole's two ends.
    Pole {
        /// Upper end.
        upper_px: Point2<f64>,
        /// Lower end.
        lower_px: Point2<f64>,
    },
    /// A sign's centre and size.
    Sign {
        /// Centre.
        centre_px: Point2<f64>,
        /// Half of its size.
        radius_px: f64,
    },
    /// A lane line's vertices.
    Lane {
        /// From one end to the other.
        points_px: Vec<Point2<f64>>,
    },
}

type Colour = [u8; 3];

const POLE: Colour = [255, 40, 40];
const TRUNK: Colour = [255, 140, 40];
const SIGN: Colour = [255, 230, 0];
const LIGHT: Colour = [0, 230, 255];
const LANE: Colour = [40, 255, 40];
/// What comes from the map is of one colour that no feature has.
const MAP: Colour = [255, 60, 255];

/// Half the length of the bars at the ends of poles, pixels.
const END_BAR_PX: f64 = 4.0;

/// A copy of `image` with features and landmarks drawn over it: poles red
/// with a bar at each end that is not cut, trunks orange, signs yellow, lights
/// cyan, lanes green with the fitted line's ends marked, landmarks magenta.
pub fn draw(image: &RgbImage, features: &Features, projected: &[ProjectedShape]) -> RgbImage {
    let mut canvas = Canvas(image.clone());
    for shape in projected {
        match shape {
            ProjectedShape::Pole { upper_px, lower_px } => canvas.line(upper_px, lower_px, MAP),
            ProjectedShape::Sign { centre_px, radius_px } => {
                canvas.rectangle(centre_px, &Vector2::repeat(2.0 * radius_px), MAP);
            }
            ProjectedShape::Lane { points_px } => canvas.polyline(points_px, MAP),
        }
    }
    for lane in &features.lanes {
        canvas.polyline(&lane.points_px, LANE);
        canvas.cross(&lane.line.upper_px, LANE);
        canvas.cross(&lane.line.lower_px, LANE);
    }
    for pole in &features.poles {
        canvas.line(&pole.upper_px, &pole.lower_px, POLE);
        let bar = Vector2::new(END_BAR_PX, 0.0);
        for (end, is_cut) in [(pole.upper_px, pole.upper_is_cut), (pole.lower_px, pole.lower_is_cut)] {
            if !is_cut {
                canvas.line(&(end - bar), &(end + bar), POLE);
            }
        }
    }
    for trunk in features.trunks.iter().flatten() {
        canvas.line(&trunk.upper_px, &trunk.lower_px, TRUNK);
    }
    for sign in &features.signs {
        let colour = if sign.kind == common::map::SignKind::TrafficLight { LIGHT } else { SIGN };
        canvas.rectangle(&sign.centre_px, &sign.extent_px, colour);
        canvas.cross(&sign.centre_px, colour);
    }
    canvas.0
}

struct Canvas(RgbImage);

impl Canvas {
    fn polyline(&mut self, points: &[Point2<f64>], colour: Colour) {
        for pair in points.windows(2) {
            self.line(&pair[0], &pair[1], colour);
        }
    }

    fn rectangle(&mut self, centre: &Point2<f64>, extent: &Vector2<f64>, colour: Colour) {
        let (x, y) = (Vector2::new(0.5 * extent.x, 0.0), Vector2::new(0.0, 0.5 * extent.y));
        let corners = [centre - x - y, centre + x - y, centre + x + y, centre - x + y, centre - x - y];
        self.polyline(&corners, colour);
    }

    fn cross(&mut self, centre: &Point2<f64>, colour: Colour) {
        for arm in [Vector2::new(3.0, 3.0), Vector2::new(3.0, -3.0)] {
            self.line(&(centre - arm), &(centre + arm), colour);
        }
    }

    /// An anti-aliased line, one pixel wide: along its longer axis, each step
    /// shares its colour between the two pixels that it passes between.
    fn line(&mut self, a: &Point2<f64>, b: &Point2<f64>, colour: Colour) {
        let Some((a, b)) = self.clip(a, b) else { return };
        let along = b - a;
        let is_steep = along.y.abs() > along.x.abs();
        let steps = along.x.abs().max(along.y.abs()).ceil().max(1.0);
        for step in 0..=steps as usize {
            let p = a + along * (step as f64 / steps);
            let (major, minor) = if is_steep { (p.y.round(), p.x) } else { (p.x.round(), p.y) };
            let share = minor - minor.floor();
            for (at, share) in [(minor.floor(), 1.0 - share), (minor.floor() + 1.0, share)] {
                let (x, y) = if is_steep { (at, major) } else { (major, at) };
                self.blend(x, y, share, colour);
            }
        }
    }

    fn blend(&mut self, x: f64, y: f64, share: f64, colour: Colour) {
        if x < 0.0 || y < 0.0 {
            return;
        }
        for (value, &new) in self.0.pixel_mut(x as usize, y as usize).into_iter().flatten().zip(&colour) {
            *value = (f64::from(*value) + (f64::from(new) - f64::from(*value)) * share).round() as u8;
        }
    }

    /// The part of a segment that is in the image or within two pixels of it,
    /// so that one from far outside costs nothing (Liang and Barsky).
    fn clip(&self, a: &Point2<f64>, b: &Point2<f64>) -> Option<(Point2<f64>, Point2<f64>)> {
        const MARGIN: f64 = 2.0;
        let along = b - a;
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (start, step, size) in [(a.x, along.x, self.0.width()), (a.y, along.y, self.0.height())] {
            let (low, high) = (-MARGIN - start, size as f64 + MARGIN - start);
            if step.abs() < 1e-12 {
                // Also where a coordinate is no number.
                if !(low <= 0.0 && high >= 0.0) {
                    return None;
                }
            } else {
                from = from.max((low / step).min(high / step));
                to = to.min((low / step).max(high / step));
            }
        }
        (from <= to && along.x.is_finite() && along.y.is_finite()).then(|| (a + along * from, a + along * to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black() -> RgbImage {
        RgbImage::new(20, vec![0; 20 * 10 * 3]).unwrap()
    }

    #[test]
    fn a_line_is_drawn_where_it_is() {
        let shape = ProjectedShape::Pole { upper_px: Point2::new(5.0, -1e9), lower_px: Point2::new(5.0, 4.0) };
        let image = draw(&black(), &Features::default(), &[shape]);
        for y in 0..10 {
            for x in 0..20 {
                let expected = if x == 5 && y <= 4 { MAP } else { [0; 3] };
                assert_eq!(image.row(y)[3 * x..3 * x + 3], expected, "{x} {y}");
            }
        }
    }

    #[test]
    fn nothing_is_drawn_outside_or_at_no_place() {
        let far = |x: f64, y: f64| ProjectedShape::Sign { centre_px: Point2::new(x, y), radius_px: 3.0 };
        let shapes = [far(-1e300, 4.0), far(f64::NAN, 2.0), far(4.0, f64::INFINITY), far(40.0, 40.0)];
        assert_eq!(draw(&black(), &Features::default(), &shapes), black());
    }
}
