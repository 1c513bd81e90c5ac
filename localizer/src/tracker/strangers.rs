//! What is seen and is not in the map, where the map has something else.

use super::health::HealthConfig;
use crate::associate::foreseen::Foreseen;

/// Images that show posts, and not one that the map has there, since one last did: where lane
/// lines alone hold a pose, it may be anywhere along its road.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Strangers {
    images: usize,
    posts: f64,
    /// What the map promises of them, as [`Foreseen::expected`] has it.
    expected: f64,
}

impl Strangers {
    /// Takes in what an image showed of what it should, and of posts.
    pub fn see(&mut self, now: &Foreseen) {
        if now.found > 0.0 || now.known > 0.0 {
            *self = Self::default();
        } else if now.seen > 0.0 {
            self.images += 1;
            self.posts += now.seen;
            self.expected += now.expected;
        }
    }

    /// Whether nothing of what stands there is known.
    pub fn are_all(self, health: &HealthConfig) -> bool {
        self.images >= health.strange_images
            && self.posts >= health.most_strange
            && self.expected >= health.most_missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strange_is_what_is_seen_where_the_map_has_something_else() {
        let health =
            HealthConfig { strange_images: 3, most_strange: 12.0, most_missing: 3.0, ..HealthConfig::default() };
        let strange = Foreseen { expected: 1.0, found: 0.0, seen: 4.0, known: 0.0 };
        let of = |shown: &[Foreseen]| {
            let mut strangers = Strangers::default();
            for now in shown {
                strangers.see(now);
            }
            strangers.are_all(&health)
        };
        assert!(of(&[strange; 3]) && !of(&[strange; 2]));
        // One that is known, of posts or of signs.
        for known in [Foreseen { known: 1.0, ..strange }, Foreseen { found: 0.9, ..strange }] {
            assert!(!of(&[strange, strange, known, strange, strange]));
        }
        // Where the map promises nothing, or nothing is seen, nothing is told.
        let (bare, blind) = (Foreseen { expected: 0.1, ..strange }, Foreseen { seen: 0.0, ..strange });
        assert!(!of(&[bare; 9]) && !of(&[blind; 9]));
        assert!(of(&[strange, bare, strange, blind, strange]));
        assert!(!of(&[strange, bare, bare]));
        // Few posts are false ones.
        assert!(!of(&[Foreseen { seen: 1.0, ..strange }; 9]));
    }
}
