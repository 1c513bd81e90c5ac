//! Which of the speeds that the road shows is believed.

use super::config::RoadConfig;
use super::road::Shift;

/// The speed that is known, and what the road showed of it.
#[derive(Debug, Default)]
pub(super) struct Speed {
    /// The last one, m/s; none before the first, and where nothing was seen for too long.
    known_m_s: Option<f64>,
    /// Time since that was seen, seconds.
    unseen_s: f64,
    /// The last speed that the road showed clearly, believed or not, and when,
    /// seconds.
    shown: Option<(f64, f64)>,
    /// Since that the images could not be followed: it says nothing of the next.
    was_astray: bool,
    /// Images in a row in which the road showed a speed to which a vehicle may have sped up, or
    /// slowed down as gently, from the one before.
    steady: usize,
    /// Images in a row in which the road showed a speed that cannot have followed the last.
    contradicting: usize,
}

/// What the road tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Told {
    Nothing,
    Speed,
    /// One that cannot have followed the last, which was wrong.
    AnotherSpeed,
}

impl Speed {
    /// The last one, m/s.
    pub fn known_m_s(&self) -> Option<f64> {
        self.known_m_s
    }

    /// The images could not be followed: nothing is known.
    pub fn lose(&mut self) {
        (self.known_m_s, self.unseen_s, self.was_astray) = (None, 0.0, true);
    }

    /// So much later. What is so long ago that any speed may have followed is not known.
    pub fn advance(&mut self, dt_s: f64, road: &RoadConfig) {
        self.unseen_s += dt_s;
        if road.hardest_m_s2 * self.unseen_s > road.fastest_m_s {
            self.known_m_s = None;
        }
    }

    /// Takes in a speed that was seen, m/s.
    pub fn know(&mut self, speed_m_s: f64) {
        (self.known_m_s, self.unseen_s) = (Some(speed_m_s), 0.0);
    }

    /// How far it can have gone back in this time, metres: not at all where it
    /// went forward faster than it brakes.
    pub fn most_back_m(&self, dt_s: f64, road: &RoadConfig) -> f64 {
        let most_m_s = self.known_m_s.map_or(f64::INFINITY, |speed_m_s| road.hardest_m_s2 * dt_s - speed_m_s);
        most_m_s.clamp(0.0, road.fastest_back_m_s) * dt_s
    }

    /// How far forward to look for it after this time, metres: at the usual rates at all
    /// speeds, whatever the last one was; where images come more seldom, at all that can have
    /// followed it, and while none is known as far as the road is seen.
    pub fn most_m(&self, dt_s: f64, road: &RoadConfig) -> f64 {
        let most_m = road.fastest_m_s * dt_s;
        match self.known_m_s {
            _ if !road.are_seldom(dt_s) => most_m,
            Some(speed_m_s) => most_m.min((speed_m_s + road.speeds_up_m_s2 * self.unseen_s) * dt_s),
            None => most_m.min(road.farthest_shift_m()),
        }
    }

    /// What a shift of the road tells: whether it is a speed at all, and one that can have
    /// followed the last, and the last that it showed: what is seen twice is no chance, and the
    /// times of both are good. Where it goes on to tell another one, the last was wrong,
    /// and so are the depths of the points that tell it. Where images come so seldom that the
    /// first may be more than the road shows, it has to go on to tell that, too.
    pub fn hear(&mut self, shift: &Shift, time_s: f64, dt_s: f64, road: &RoadConfig) -> Told {
        let least_lead = road.least_lead * (1.0 - shift.correlation);
        if shift.correlation < road.least_correlation || shift.lead < least_lead {
            return Told::Nothing;
        }
        let speed_m_s = shift.forward_m / dt_s;
        let was_astray = std::mem::take(&mut self.was_astray);
        let shown = self.shown.replace((speed_m_s, time_s)).filter(|_| !was_astray);
        let has_changed_by = |most_m_s2: f64| {
            shown.is_some_and(|(last_m_s, last_s)| (speed_m_s - last_m_s).abs() <= most_m_s2 * (time_s - last_s))
        };
        self.steady = if has_changed_by(road.speeds_up_m_s2) { self.steady + 1 } else { 0 };
        let is_steady = has_changed_by(road.hardest_m_s2);
        let contradicts = is_steady && !self.is_next(speed_m_s, road);
        self.contradicting = if contradicts { self.contradicting + 1 } else { 0 };
        if self.contradicting >= road.believed_after {
            (self.contradicting, self.known_m_s, self.unseen_s) = (0, None, 0.0);
            return Told::AnotherSpeed;
        }
        let may_be_more = self.known_m_s.is_none() && road.fastest_m_s * dt_s > road.farthest_shift_m();
        let is_believed = if may_be_more { self.steady >= road.believed_after } else { is_steady && !contradicts };
        if is_believed { Told::Speed } else { Told::Nothing }
    }

    /// Whether a speed can have followed the last one.
    pub fn is_next(&self, speed_m_s: f64, road: &RoadConfig) -> bool {
        self.known_m_s.is_none_or(|last_m_s| (speed_m_s - last_m_s).abs() <= road.hardest_m_s2 * self.unseen_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_is_looked_for_where_it_can_have_followed_the_last_until_that_is_long_ago() {
        let road = RoadConfig::default();
        let mut speed = Speed::default();
        let looks_to = |speed: &Speed, dt_s: f64, way_m: f64| (speed.most_m(dt_s, &road) - way_m).abs() < 1e-9;
        // At 10 Hz any speed is, at 2 Hz what the road shows.
        assert!(looks_to(&speed, 0.1, 4.5) && looks_to(&speed, 0.5, 10.0));
        speed.know(8.0);
        speed.advance(0.5, &road);
        // Half a second at 8 m/s and what it speeds up by.
        assert!(looks_to(&speed, 0.1, 4.5) && looks_to(&speed, 0.5, 5.75));
        assert!(speed.is_next(17.0, &road) && !speed.is_next(19.0, &road));
        speed.advance(1.5, &road);
        assert!(speed.known_m_s().is_some());
        speed.advance(0.5, &road);
        assert!(speed.known_m_s().is_none() && looks_to(&speed, 0.5, 10.0));
    }
}
