//! The fronts of an earlier comparison, read from its `frontier.json`, beside those of a new one.

use std::path::Path;

use model_format::limits::MAX_ORDER;
use serde::Deserialize;
use stylus_costs::Structure;

use super::results::{Frontier, order_text, parsed, unusable};
use crate::fit::Order;
use crate::support::error::Result;

/// An earlier comparison.
#[derive(Clone, Debug, Deserialize)]
pub struct Earlier {
    filters: Vec<EarlierFilter>,
    points: Vec<EarlierPoint>,
}

/// A structure at an order, as [`super::Filter`].
#[derive(Clone, Copy, Debug, Deserialize)]
struct EarlierFilter {
    structure: Structure,
    order: Order,
    highest_order: usize,
}

/// A filter with an interval, as [`super::Point`]. What is not a number has no value in the file.
#[derive(Clone, Copy, Debug, Deserialize)]
struct EarlierPoint {
    filter: usize,
    interval: usize,
    total_error_db: Option<f64>,
    cycles: Option<f64>,
    on_front: bool,
    on_safe_front: bool,
}

/// A choice of structure, order and interval with its place, in one comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Cycles per sample, updates included.
    pub cycles: f64,
    /// Error at rest and in motion together, dB.
    pub error_db: f64,
    /// True if nothing cheaper has as low an error.
    pub on_front: bool,
    /// The same among what holds every hard case.
    pub on_safe_front: bool,
}

/// A choice that is on a front, before or now.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The structure.
    pub structure: Structure,
    /// The order, in words.
    pub order: String,
    /// Samples from one update to the next.
    pub interval: usize,
    /// In the earlier comparison, if it was in it.
    pub before: Option<Place>,
    /// In the new one, if it is in it.
    pub now: Option<Place>,
}

impl Earlier {
    /// Reads the numbers that `stylus frontier` wrote.
    ///
    /// # Errors
    /// A file that cannot be read or is no such file.
    pub fn read(path: &Path) -> Result<Self> {
        let earlier: Self = parsed(path)?;
        let filters = earlier.filters.len();
        if earlier.points.iter().any(|point| point.filter >= filters) {
            return Err(unusable(path, "has a choice without its filter"));
        }
        Ok(earlier)
    }

    /// The places of its front of what holds every hard case, cheapest first: cycles per sample and error, dB.
    pub fn safe_front(&self) -> Vec<(f64, f64)> {
        let on_front = self.points.iter().filter(|point| point.on_safe_front);
        let mut places: Vec<(f64, f64)> = on_front
            .filter_map(|point| Some((point.cycles?, point.total_error_db?)))
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        places
    }

    /// Every choice that was on a front of this comparison or is on one of `now`, by its cycles now, or before.
    pub fn changes(&self, now: &Frontier) -> Vec<Change> {
        let mut changes: Vec<Change> = Vec::new();
        for point in &now.points {
            let filter = &now.filters[point.filter];
            changes.push(Change {
                structure: filter.structure.into(),
                order: filter.order_text(),
                interval: point.interval,
                before: self.place(filter.structure.into(), filter.order, point.interval),
                now: Some(Place {
                    cycles: point.cycles,
                    error_db: point.total_error_db,
                    on_front: point.on_front,
                    on_safe_front: point.on_safe_front,
                }),
            });
        }
        for point in &self.points {
            let filter = &self.filters[point.filter];
            let is_known = now.points.iter().any(|other| {
                let there = &now.filters[other.filter];
                let same = Structure::from(there.structure) == filter.structure;
                same && is_same(there.order, filter.order) && other.interval == point.interval
            });
            if !is_known {
                changes.push(Change {
                    structure: filter.structure,
                    order: order_text(filter.order, filter.highest_order),
                    interval: point.interval,
                    before: point.place(),
                    now: None,
                });
            }
        }
        let is_on_a_front = |place: &Place| place.on_front || place.on_safe_front;
        changes.retain(|change| {
            let places = [change.before, change.now];
            places.iter().flatten().any(is_on_a_front)
        });
        let cycles = |change: &Change| {
            let place = change.now.or(change.before);
            place.map_or(f64::INFINITY, |place| place.cycles)
        };
        changes.sort_by(|a, b| cycles(a).total_cmp(&cycles(b)));
        changes
    }

    fn place(&self, structure: Structure, order: Order, interval: usize) -> Option<Place> {
        let point = self.points.iter().find(|point| {
            let filter = &self.filters[point.filter];
            let same = filter.structure == structure && is_same(filter.order, order);
            same && point.interval == interval
        });
        point?.place()
    }
}

impl EarlierPoint {
    fn place(&self) -> Option<Place> {
        Some(Place {
            cycles: self.cycles?,
            error_db: self.total_error_db?,
            on_front: self.on_front,
            on_safe_front: self.on_safe_front,
        })
    }
}

/// Returns whether both are the same choice. Akaike's criterion up to the format's highest order has two names.
fn is_same(a: Order, b: Order) -> bool {
    let plain = |order| match order {
        Order::AtMost(MAX_ORDER) => Order::Auto,
        other => other,
    };
    plain(a) == plain(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"material": "ignored", "filters": [
        {"structure": "normalised_lattice_32", "order": {"fixed": 20}, "highest_order": 20},
        {"structure": "direct_form_32", "order": {"at_most": 400}, "highest_order": 130}],
        "points": [
        {"filter": 0, "interval": 10, "total_error_db": 4.5, "cycles": 900.0,
         "on_front": true, "on_safe_front": true},
        {"filter": 0, "interval": 25, "total_error_db": 5.5, "cycles": 700.0,
         "on_front": false, "on_safe_front": true},
        {"filter": 1, "interval": 10, "total_error_db": null, "cycles": 50.0,
         "on_front": false, "on_safe_front": false}]}"#;

    fn written(text: &str) -> Result<Earlier> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frontier.json");
        std::fs::write(&path, text).unwrap();
        Earlier::read(&path)
    }

    #[test]
    fn the_front_is_read_from_the_cheapest_on_and_what_has_no_error_is_nowhere() {
        let earlier = written(TEXT).unwrap();
        assert_eq!(earlier.safe_front(), [(700.0, 5.5), (900.0, 4.5)]);
        let lattice = Structure::NormalisedLattice32;
        let place = earlier.place(lattice, Order::Fixed(20), 10).unwrap();
        assert_eq!((place.cycles, place.on_safe_front), (900.0, true));
        assert_eq!(earlier.place(lattice, Order::Fixed(50), 10), None);
        assert_eq!(
            earlier.place(Structure::DirectForm32, Order::Auto, 10),
            None
        );
    }

    #[test]
    fn what_is_no_comparison_is_refused_with_a_remedy() {
        for text in [
            "",
            "{}",
            "[1]",
            &TEXT.replace("\"filter\": 1", "\"filter\": 2"),
        ] {
            let refused = written(text).unwrap_err().to_string();
            assert!(refused.contains("give a frontier.json"), "{refused}");
        }
    }
}
