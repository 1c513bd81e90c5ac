//! That maps which are put together are of one frame.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::input::MapFrame;
use crate::merge::frame_beside;
use crate::report::read_beside;

/// The frame of some maps, and the first of them that told it.
#[derive(Debug, Clone, Default)]
pub struct OneFrame(Option<(PathBuf, MapFrame)>);

impl OneFrame {
    /// Takes a map in. One of whose frame nothing is known goes with any other.
    ///
    /// # Errors
    /// [`Error::FramesApart`] where its metres are not those of the maps before it.
    pub fn add(&mut self, map: &Path, frame: Option<MapFrame>) -> Result<()> {
        let Some(frame) = frame else { return Ok(()) };
        let (first, of_first) = self.0.get_or_insert_with(|| (map.to_path_buf(), frame));
        if of_first.may_be(&frame) {
            return Ok(());
        }
        Err(Error::FramesApart {
            map: map.to_path_buf(),
            frame: frame.name(),
            other: first.clone(),
            other_frame: of_first.name(),
        })
    }
}

/// What the report of its build, or the sources of a merged map, say of the frame of a map of
/// these bytes. A report that cannot be read, or that of another map, says nothing of this one.
pub fn beside(map: &Path, map_bytes: &[u8]) -> Option<MapFrame> {
    let report = read_beside(map, map_bytes).unwrap_or_default().own;
    report.and_then(|report| report.frame).or_else(|| frame_beside(map, map_bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::SurveyFrame;
    use nalgebra::Vector3;

    #[test]
    fn maps_of_frames_that_are_known_to_differ_are_told() {
        let zone = |x, y| MapFrame::of_survey(SurveyFrame::Lidar, &Vector3::new(x, y, 0.0));
        // The same, as a world with the axes of a camera has it.
        let turned = MapFrame::of_survey(SurveyFrame::Camera, &Vector3::new(-10_000.0, 0.0, 450_000.0));
        let raw = |text: &str| MapFrame::of_first_camera(Some(text.parse().unwrap()));
        let put = |frames: &[Option<MapFrame>]| {
            let mut one = OneFrame::default();
            let names = ["a.csm", "b.csm", "c.csm"];
            names.iter().zip(frames).try_for_each(|(name, frame)| one.add(Path::new(name), *frame))
        };
        let near = zone(450_000.0, 10_000.0);
        assert!(put(&[None, Some(near), Some(near)]).is_ok() && put(&[Some(near), None, Some(turned)]).is_ok());
        let said = put(&[None, Some(near), Some(zone(450_000.0, 20_000.0))]).unwrap_err().to_string();
        let frames = "c.csm is reduced by (450000, 20000, 0) m, and b.csm is reduced by (450000, 10000, 0) m";
        assert!(said.contains(frames) && said.contains("--reduce"), "{said}");
        assert!(put(&[Some(raw("49,8,100")), Some(MapFrame::of_first_camera(None))]).is_ok());
        assert!(put(&[Some(raw("49,8,100")), Some(raw("49,8.1,100"))]).is_err());
        assert!(put(&[Some(raw("49,8,100,30")), Some(raw("49,8.000000000000002,100,30"))]).is_ok());
        assert!(put(&[Some(raw("49,8,100,30")), Some(raw("49,8,100,31"))]).is_err());
    }
}
