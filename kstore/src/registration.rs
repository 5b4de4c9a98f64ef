//! Where the vehicle stands by the stored trees: a pose that jumped, drifted or was begun anew must not double them.
//!
//! In: the trees of a snapshot as the pose places them, and the stored ones. Out: the correction by which all
//! sightings of the snapshot are moved before they are merged.
//!
//! While the trees in sight stand where stored ones stand, the correction follows their mean offset (slow drift) from
//! those that have been known for a while, and falls back to none with a long time constant, so that a long way through unknown woods cannot lead it astray. Where
//! they do not, the offset that most pairs of trees agree with is taken, if no other comes near it. Until then the
//! pose is in doubt: what is stored meanwhile is *loose*, moves along when the offset is found, and nothing is held
//! against objects that are not seen.

mod settle;

use crate::correction::{Correction, minus};
use crate::reproject::Reprojection;
use std::collections::BTreeSet;
use tsense_geometry::Timestamp;

/// A tree in sight agrees with a stored one within this, metres: less than half of the smallest jump that matters,
/// more than the noise of both positions and a degree of turn at fifteen metres.
const AGREE_M: f64 = 0.4;

/// How the pose lies to the stored trees.
#[derive(Clone, Debug, Default)]
pub struct Registration {
    correction: Correction,
    /// The epoch and the newest snapshot.
    last: Option<(u64, Timestamp, [f64; 2])>,
    /// Stored trees confirm the correction, or there are none that could.
    firm: bool,
    /// Objects made, or not yet believed in, while it was not firm.
    loose: BTreeSet<u64>,
    /// Trees in sight contradict the correction.
    in_doubt: bool,
    /// Times a move was found by consensus.
    moved: u64,
}

impl Registration {
    /// The correction now.
    pub fn correction(&self) -> Correction {
        self.correction
    }
    /// True where stored trees confirm it, or none could.
    pub fn is_firm(&self) -> bool {
        self.firm
    }
    /// True where trees in sight contradict it.
    pub fn is_in_doubt(&self) -> bool {
        self.in_doubt
    }
    /// How often a move was found by consensus.
    pub fn moved(&self) -> u64 {
        self.moved
    }
    /// Remembers an object made while the pose was not firm.
    pub fn made(&mut self, id: u64) {
        if !self.firm {
            self.loose.insert(id);
        }
    }
    /// The store moves to another zone, whose grid is turned against the old one's.
    pub fn move_to_zone(&mut self, reprojection: Option<&Reprojection>) {
        let place = |p: [f64; 2]| reprojection.and_then(|r| r.apply(p));
        let Some((_, _, vehicle_m)) = self.last else { return };
        let moved = place(vehicle_m).zip(place(self.correction.vehicle(vehicle_m)));
        self.correction.offset_m = moved.map_or([0.0; 2], |(from, to)| minus(to, from));
    }
    fn go_by(&mut self, found: &Correction) {
        self.correction = self.correction.then(found);
        self.moved += u64::from(found.length_m() > AGREE_M);
        self.in_doubt = false;
    }
}
