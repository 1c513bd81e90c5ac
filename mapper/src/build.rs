//! From a drive to its map.

use common::geometry::Pose;
use common::map::{LaneLine, Pole, RoadId, SemanticMap, Sign, marks_along};
use nalgebra::Point3;

use crate::cloud::{Cloud, without_standing};
use crate::config::Config;
use crate::drive::Drive;
use crate::error::{Error, Result};
use crate::evidence::EvidenceBook;
use crate::lanes::{LanePiece, Paint, find_side_lines, kerbs_along, lines_along};
use crate::passes::Passes;
use crate::path::Way;
use crate::poles::{FittedPole, find_poles};
use crate::register::{Registration, jumps_by_times, refine};
use crate::roads::{RoadConfig, Stretch, road, stretches};
use crate::signs::{find_signs, name_posts};

/// Where the poses of a build come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseSource {
    /// The survey's poses, refined by registering the scans.
    #[default]
    Refine,
    /// The survey's poses as given.
    Given,
}

/// A map and how it came about.
#[derive(Debug, Clone)]
pub struct Built {
    /// The map.
    pub map: SemanticMap,
    /// The poses that it was built with.
    pub registration: Registration,
    /// How well the landmarks of each window are known.
    pub evidence: EvidenceBook,
}

/// A window of the drive while the map is built.
pub struct Window<'a> {
    /// Its stitched cloud.
    pub cloud: &'a Cloud,
    /// Stations (m) between which it owns what it sees: clouds of neighbours overlap,
    /// what they own does not.
    pub owned: std::ops::Range<f64>,
    /// Poles found between them.
    pub poles: Vec<Pole>,
    /// Signs found between them.
    pub signs: &'a [Sign],
    /// Lane lines found between them.
    pub lanes: &'a [LaneLine],
    /// Number of windows done, this one included.
    pub done: usize,
    /// Number of windows of the drive.
    pub count: usize,
}

/// What a window of the drive gives.
struct Found {
    poles: Vec<(Pole, FittedPole)>,
    signs: Vec<Sign>,
    lanes: Vec<LaneLine>,
}

/// Builds the map of a drive. `on_window` is called with each window once
/// its landmarks are found. The lidar is taken for what `config.lidar` says:
/// [`crate::lidar::measured`] asks the scans before.
///
/// # Errors
/// A scan that cannot be read, what `on_window` returns,
/// [`Error::FarFromOrigin`], [`Error::SurveyJumps`], [`Error::NothingSeen`] and
/// [`Error::NoGround`].
pub fn build(
    drive: &Drive,
    poses: PoseSource,
    config: &Config,
    mut on_window: impl FnMut(&Window) -> Result<()>,
) -> Result<Built> {
    check_survey(drive, &config.roads)?;
    let registration = match poses {
        PoseSource::Refine => refine(drive, &config.refine)?,
        PoseSource::Given => {
            Registration { jumps: jumps_by_times(drive, &config.refine.jumps), ..Registration::given(&drive.survey) }
        }
    };
    let poses = &registration.map_from_camera;
    let (first, last) = drive.span();
    let cut = stretches(poses, first, last, &config.roads);
    let mut map = SemanticMap {
        frame_note: drive.name(),
        roads: cut.iter().filter(|s| !s.is_again).map(|s| road(poses, s, &config.roads)).collect(),
        ..SemanticMap::default()
    };
    let windows: Vec<&[Stretch]> = cut.chunks(config.roads.per_window.max(1)).collect();
    let mut passes = Passes::default();
    let mut evidence = EvidenceBook::default();
    let (mut under_path, mut shown, mut points) = (0.0_f64, 0.0_f64, 0);
    for (k, window) in windows.iter().enumerate() {
        let ends = (k == 0, k + 1 == windows.len());
        let (cloud, owned) = stitch_window(drive, &registration, window, ends, config)?;
        under_path = under_path.max(cloud.ground.under_path());
        shown = shown.max(cloud.ground.shown());
        points += cloud.scans.iter().map(|scan| scan.points).sum::<usize>();
        let found = extract(&cloud, &owned, &map, config);
        let window_poles: Vec<Pole> = found.poles.iter().map(|(pole, _)| *pole).collect();
        let known = evidence.add(&cloud, &window_poles, &found.signs, &found.lanes, config);
        on_window(&Window {
            cloud: &cloud,
            owned,
            poles: window_poles,
            signs: &found.signs,
            lanes: &found.lanes,
            done: k + 1,
            count: windows.len(),
        })?;
        let poles = found.poles.into_iter().map(|(pole, _)| pole).collect();
        passes.add(k as u32, &known, poles, found.signs, found.lanes);
    }
    if points == 0 {
        return Err(Error::NothingSeen { scans: drive.folder() });
    }
    if under_path < config.ground.least_under_path {
        let why = if shown > 0.0 {
            "scans and poses do not belong together"
        } else {
            "no scan shows anything of it, so they hold no returns of the ground, or scans and poses do not belong together"
        };
        return Err(Error::NoGround { scans: drive.folder(), seen_percent: 100.0 * under_path, why });
    }
    passes.join(&mut map, &config.fuse);
    Ok(Built { map, registration, evidence })
}

/// Stitches the cloud of a window and tells which stations it owns: all that
/// lie before and behind it too where the drive ends there.
fn stitch_window(
    drive: &Drive,
    registration: &Registration,
    window: &[Stretch],
    (is_first, is_last): (bool, bool),
    config: &Config,
) -> Result<(Cloud, std::ops::Range<f64>)> {
    let poses = &registration.map_from_camera;
    let (first, last) = (window[0].first, window[window.len() - 1].last);
    let margin = config.cloud.beyond_m;
    let longest_m = config.roads.longest_step_m;
    let (from, to) = (reach(poses, first, -1, margin, longest_m), reach(poses, last, 1, margin, longest_m));
    let frames: Vec<usize> = drive.frames.iter().copied().filter(|f| (from..=to).contains(f)).collect();
    let frames = without_standing(&frames, poses, config.cloud.most_from_one_place);
    let cloud = Cloud::stitch(drive, &frames, registration, config)?;
    let station = |f: usize| cloud.place(&poses[f].translation.vector.into()).station_m;
    let start = if is_first { f64::NEG_INFINITY } else { station(first) };
    let end = if is_last { f64::INFINITY } else { station(last) };
    Ok((cloud, start..end))
}

/// The way between the cameras of two frames, metres.
fn apart_m(poses: &[Pose], a: usize, b: usize) -> f64 {
    (poses[b].translation.vector - poses[a].translation.vector).norm()
}

/// That the frames to stitch lie near the origin, and follow each other as those of
/// one drive do.
fn check_survey(drive: &Drive, config: &RoadConfig) -> Result<()> {
    let (longest_m, farthest_m) = (config.longest_step_m, config.farthest_m);
    let (first, last) = drive.span();
    for frame in first..=last {
        let distance_m = drive.survey[frame].translation.vector.norm();
        if distance_m > farthest_m || distance_m.is_nan() {
            return Err(Error::FarFromOrigin { path: drive.survey_path.clone(), frame, distance_m, farthest_m });
        }
    }
    for (before, after) in (first..last).zip(first + 1..) {
        let apart_m = apart_m(&drive.survey, before, after);
        if apart_m > longest_m {
            return Err(Error::SurveyJumps { path: drive.survey_path.clone(), before, after, apart_m, longest_m });
        }
    }
    Ok(())
}

/// The frame reached from `frame` after `distance_m` along the drive, or before a
/// step of more than `longest_m`.
fn reach(poses: &[Pose], frame: usize, step: isize, distance_m: f64, longest_m: f64) -> usize {
    let centre = |f: usize| Point3::from(poses[f].translation.vector);
    let mut way = Way::default();
    let (mut at, mut driven_m) = (frame, way.to(centre(frame)));
    while driven_m < distance_m {
        let next = at as isize + step;
        if next < 0 || next as usize >= poses.len() {
            break;
        }
        let next = next as usize;
        if apart_m(poses, at, next) > longest_m {
            break;
        }
        driven_m = way.to(centre(next));
        at = next;
    }
    at
}

/// The landmarks of a cloud whose stations lie in a range.
fn extract(cloud: &Cloud, owned: &std::ops::Range<f64>, map: &SemanticMap, config: &Config) -> Found {
    let road_of = |p: &Point3<f64>| map.nearest_road(p).unwrap_or(RoadId(0));
    let owns = |p: &Point3<f64>| owned.contains(&cloud.place(p).station_m);
    let ((poles, signs), (lanes, side_lanes)) = rayon::join(
        || {
            // Signs hang on posts.
            let mut poles = find_poles(cloud, &config.poles, &config.lidar);
            let signs = find_signs(cloud, &poles, config);
            name_posts(&mut poles, &signs, &config.poles);
            (poles, signs)
        },
        || {
            let lanes = find_lanes(cloud, config);
            let painted: Vec<LanePiece> = lanes.iter().filter(|lane| lane.kind.is_painted()).cloned().collect();
            let side_lanes = find_side_lines(cloud, &painted, &config.lanes);
            (lanes, side_lanes)
        },
    );
    let side_lane = |piece: LanePiece| {
        let middle = nalgebra::center(piece.points_map.first()?, piece.points_map.last()?);
        let marks_m = marks_along(&piece.points_map, &piece.marks_map(), ON_LINE_M);
        let LanePiece { kind, points_map, .. } = piece;
        owns(&middle).then(|| LaneLine { kind, points_map, road: road_of(&middle), marks_m })
    };
    Found {
        poles: poles
            .into_iter()
            .filter(|(_, p)| owns(&p.foot))
            .map(|(kind, p)| (Pole { kind, foot_map: p.foot, top_map: p.top, road: road_of(&p.foot) }, p))
            .collect(),
        signs: signs
            .into_iter()
            .filter(|s| owns(&s.centroid))
            .map(|s| Sign { kind: s.kind, centroid_map: s.centroid, size_m: s.size_m, road: road_of(&s.centroid) })
            .collect(),
        lanes: lanes
            .iter()
            .flat_map(|piece| by_road(piece, cloud, owned, map, config))
            .chain(side_lanes.into_iter().filter_map(side_lane))
            .collect(),
    }
}

/// The lane lines along the path of a stitched cloud; kerbs where nothing is painted.
pub fn find_lanes(cloud: &Cloud, config: &Config) -> Vec<LanePiece> {
    let paint = Paint::of(cloud, &config.lanes);
    let mut lanes = lines_along(&cloud.path, &paint, cloud, &config.lanes);
    lanes.extend(kerbs_along(&cloud.path, &paint, &lanes, &config.lanes.kerbs));
    lanes
}

/// How far a mark may lie off its own line, metres: it is on it but for
/// rounding.
const ON_LINE_M: f64 = 0.05;

/// Shortest piece worth its vertices, metres.
const SHORTEST_PIECE_M: f64 = 2.0;

/// Cuts a lane line where one road ends and the next begins, and at the
/// borders of what is owned.
fn by_road(
    piece: &LanePiece,
    cloud: &Cloud,
    owned: &std::ops::Range<f64>,
    map: &SemanticMap,
    config: &Config,
) -> Vec<LaneLine> {
    let marks_map = piece.marks_map();
    let mut cuts: Vec<f64> = map
        .roads
        .iter()
        .filter_map(|r| r.path_map.first())
        .map(|p| cloud.place(p))
        // Roads elsewhere fall on the ends of this window's path, off it;
        // where another pass gave the road, it begins on another lane.
        .filter(|place| place.offset_m.abs() < config.roads.carriageway_m)
        .map(|place| place.station_m)
        .filter(|s| *s > 1.0 && owned.contains(s))
        .collect();
    cuts.push(owned.start);
    cuts.push(owned.end);
    cuts.sort_by(f64::total_cmp);
    cuts.windows(2)
        .filter_map(|w| {
            let points = piece.part(w[0], w[1], SHORTEST_PIECE_M)?.points_map;
            let middle = points.get(points.len() / 2)?;
            let first = points.first()?;
            let centre = if points.len() == 2 { nalgebra::center(first, middle) } else { *middle };
            let road = map.nearest_road(&centre)?;
            let marks_m = marks_along(&points, &marks_map, ON_LINE_M);
            (points.len() >= 2).then_some(LaneLine { kind: piece.kind, points_map: points, road, marks_m })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_uses_up_nothing_of_what_is_seen_beyond_a_window() {
        // 600 frames at a light, and on.
        let shaking = |i: i32| Pose::translation(0.03 * f64::from(i % 3), 0.0, 0.02 * f64::from(i % 2));
        let poses: Vec<Pose> =
            (0..600).map(shaking).chain((1..100).map(|i| Pose::translation(0.0, 0.0, f64::from(i)))).collect();
        assert_eq!(reach(&poses, 0, 1, 40.0, 500.0), 599 + 40);
        assert_eq!(reach(&poses, 639, -1, 39.5, 500.0), 599);
        assert_eq!(reach(&poses, 0, 1, 400.0, 500.0), 698);
    }
}
