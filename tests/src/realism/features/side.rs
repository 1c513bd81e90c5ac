//! One of the two drives.

use std::path::{Path, PathBuf};

use common::geometry::{PinholeCamera, Pose};
use common::kitti;
use common::map::{SemanticMap, read};
use common::trajectory::Trajectory;
use localizer::camera::Source;
use localizer::drive::Drive;
use localizer::features::Features;
use localizer::vision::{ProbabilityMaps, VisionConfig};
use nalgebra::{Point2, Point3};

/// A drive with its label images, its map, and the poses in that map.
pub struct Side {
    drive: Drive,
    source: Source,
    trajectory: Trajectory,
    /// The map that the mapper built.
    pub map: SemanticMap,
}

/// What one frame gives.
pub struct View {
    /// Its number.
    pub frame: usize,
    /// The camera.
    pub camera: PinholeCamera,
    /// Where it was.
    pub camera_from_map: Pose,
    /// The label images.
    pub maps: ProbabilityMaps,
    /// What the localizer makes of them.
    pub features: Features,
    depths: Depths,
}

impl Side {
    /// Opens everything.
    pub fn open(
        root: &Path,
        sequence: &str,
        labels: &Path,
        map: &Path,
        trajectory: &Path,
        last: Option<usize>,
    ) -> Result<Self, String> {
        let drive = Drive::open(root, sequence, Some(labels), 0, last, VisionConfig::default().widest_px)
            .map_err(|e| e.to_string())?;
        let trajectory = Trajectory::read_kitti(trajectory, &drive.times_s).map_err(|e| e.to_string())?;
        let map = read(map).map_err(|e| e.to_string())?;
        Ok(Self { drive, source: Source::Labels(PathBuf::from(labels)), trajectory, map })
    }

    /// The frames, ascending.
    pub fn frames(&self) -> &[usize] {
        &self.drive.frames
    }

    /// What a frame gives.
    pub fn view(&self, frame: usize, config: &VisionConfig) -> Result<View, String> {
        let seen = self.drive.see(frame, &self.source, config).map_err(|e| e.to_string())?;
        let stamp = self.trajectory.at_frame(frame).ok_or(format!("the trajectory has no pose for frame {frame}"))?;
        let calibration = self.drive.sequence.calibration().map_err(|e| e.to_string())?;
        let scan = kitti::read_scan(self.drive.sequence.scan_path(frame), 120.0).map_err(|e| e.to_string())?;
        let camera = self.drive.camera.pinhole;
        let mut depths = Depths::new(seen.maps.width(), seen.maps.height());
        for point in &scan.points {
            let in_velodyne = Point3::new(f64::from(point.x_m), f64::from(point.y_m), f64::from(point.z_m));
            let in_camera = calibration.camera_from_velodyne * in_velodyne;
            if let Some(pixel) = camera.project(&in_camera, 1.0) {
                depths.add(&pixel, in_camera.z);
            }
        }
        Ok(View {
            frame,
            camera,
            camera_from_map: stamp.map_from_camera.inverse(),
            maps: seen.maps,
            features: seen.features,
            depths,
        })
    }
}

impl View {
    /// A map point in the image, with its depth (metres).
    pub fn project(&self, point_map: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        let in_camera = self.camera_from_map * point_map;
        Some((self.camera.project(&in_camera, 1.0)?, in_camera.z))
    }

    /// Width and height of the image, pixels.
    pub fn size(&self) -> (f64, f64) {
        (self.maps.width() as f64, self.maps.height() as f64)
    }

    /// Whether a pixel lies in the image, `margin_px` from its border.
    pub fn contains(&self, p: &Point2<f64>, margin_px: f64) -> bool {
        let (width, height) = self.size();
        p.x >= margin_px && p.y >= margin_px && p.x <= width - 1.0 - margin_px && p.y <= height - 1.0 - margin_px
    }

    /// Whether the frame's scan shows something well before what lies at this
    /// depth in this pixel.
    pub fn is_hidden(&self, p: &Point2<f64>, depth_m: f64) -> bool {
        self.depths.nearest_m(p) < depth_m - f64::max(1.5, 0.07 * depth_m)
    }
}

/// The nearest point of a scan in each cell of the image. A cell is as large
/// as the distance of a scan's rings (0.4 degrees) and twice that of its
/// columns.
struct Depths {
    columns: usize,
    nearest_m: Vec<f64>,
}

impl Depths {
    const CELL_PX: (f64, f64) = (4.0, 6.0);

    fn new(width: usize, height: usize) -> Self {
        let columns = (width as f64 / Self::CELL_PX.0).ceil() as usize;
        let rows = (height as f64 / Self::CELL_PX.1).ceil() as usize;
        Self { columns, nearest_m: vec![f64::INFINITY; columns * rows] }
    }

    fn cell(&self, p: &Point2<f64>) -> Option<usize> {
        let (i, j) = ((p.x / Self::CELL_PX.0).floor(), (p.y / Self::CELL_PX.1).floor());
        (i >= 0.0 && j >= 0.0 && (i as usize) < self.columns).then(|| j as usize * self.columns + i as usize)
    }

    fn add(&mut self, p: &Point2<f64>, depth_m: f64) {
        if let Some(nearest_m) = self.cell(p).and_then(|cell| self.nearest_m.get_mut(cell)) {
            *nearest_m = nearest_m.min(depth_m);
        }
    }

    /// Infinite where the scan has nothing.
    fn nearest_m(&self, p: &Point2<f64>) -> f64 {
        self.cell(p).and_then(|cell| self.nearest_m.get(cell)).copied().unwrap_or(f64::INFINITY)
    }
}
