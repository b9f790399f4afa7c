//! Interleavings of the requests of two hosts on two links, which do not wait for answers, with the storage's task, the
//! poll and the tick.
//!
//! The application is the device's own, on the shared fake hardware. An executor chooses at each await which task goes
//! on. [`REQUESTS`] is the list of requests: a new one is covered by a line in it, and a new await by itself, because
//! every one of them is a point at which the executor chooses.
//!
//! Held at each point: what `Watch` in `world.rs` looks at. Held at the end: every request was answered once, and the
//! device plays again.
//!
//! - All schedules of each pair of requests, and of triples by chance, are explored up to [`WAITS`]. States that were
//!   seen are not entered again; two states are the same if they have the same [`World::fingerprint`].
//! - Longer lists of requests run under random schedules, in which ticks and polls are late by up to a millisecond.

mod list;
mod world;

use std::collections::HashSet;

use fake_stylus::hardware::Hardware;
use stylus_app::TICKS_PER_MS;
use stylus_app::control::{Control, Device};

use crate::budget::{self, Chance};
use list::{PAIRED, REQUESTS, Request};
use world::{Beginning, Checked, Choice, LATEST_POLL_TICKS, World};

/// Times that time passes, in an exhaustive exploration, while a task could go on.
const WAITS: u32 = 2;

/// Choices of a random schedule after which it counts as endless.
const MOST_CHOICES: usize = 200_000;

/// A mistake after each step of the storage, so that the check can show that it would notice.
pub type Mistake = fn(&mut Control<Hardware>);

/// Nothing goes wrong.
const NONE: Mistake = |_| ();

/// Two lists of requests, and a beginning.
#[derive(Clone, Copy)]
struct Scenario<'a> {
    beginning: &'a Beginning,
    lists: [&'a [Request]; 2],
    plays: bool,
    mistake: Mistake,
}

impl Scenario<'_> {
    fn world(&self) -> World {
        World::new(self.beginning, self.lists, self.plays, self.mistake)
    }

    fn told(&self, world: &World, problem: &str) -> String {
        let names = self
            .lists
            .map(|list| list.iter().map(|request| request.name).collect::<Vec<_>>());
        format!(
            "{problem}\n{names:?}, playing before: {}, {:?}",
            self.plays, world.schedule
        )
    }

    /// Explores all schedules in which time passes at most `waits` times while a task could go on, and returns the
    /// number of states.
    fn explore(&self, waits: u32) -> Result<usize, String> {
        let mut seen = HashSet::new();
        let mut ends = HashSet::new();
        let mut open: Vec<Vec<Choice>> = vec![Vec::new()];
        while let Some(prefix) = open.pop() {
            let mut world = self.world();
            let explored = follow(&mut world, &prefix, waits, &mut seen, &mut ends, &mut open);
            explored.map_err(|problem| self.told(&world, &problem))?;
        }
        Ok(seen.len())
    }

    /// Runs one random schedule.
    fn wander(&self, chance: &mut Chance) -> Checked {
        let mut world = self.world();
        let wandered = wander(&mut world, chance);
        wandered.map_err(|problem| self.told(&world, &problem))
    }
}

/// Follows `prefix`, then takes the first choice at each point and leaves the others in `open`.
fn follow(
    world: &mut World,
    prefix: &[Choice],
    waits: u32,
    seen: &mut HashSet<String>,
    ends: &mut HashSet<String>,
    open: &mut Vec<Vec<Choice>>,
) -> Checked {
    for &choice in prefix {
        world.go_on(choice)?;
    }
    while !world.is_done() {
        if !seen.insert(format!("{} {}", world.waits, world.fingerprint())) {
            return Ok(());
        }
        let mut choices: Vec<_> = world.ready().collect();
        if choices.is_empty() {
            // The storage waits for rest, and nothing else is to be done.
            break;
        }
        if world.waits < waits {
            choices.push(Choice::Wait);
        }
        for &other in &choices[1..] {
            let mut branch = world.schedule.clone();
            branch.push(other);
            open.push(branch);
        }
        world.go_on(choices[0])?;
    }
    world.end()?;
    if ends.insert(world.fingerprint()) {
        world.plays_again()?;
    }
    Ok(())
}

fn wander(world: &mut World, chance: &mut Chance) -> Checked {
    let ticks_per_choice = 1 + chance.below(6);
    while !world.is_done() {
        let now = world.control.borrow_mut().device().now();
        let late = now - world.watch.polled_at;
        let mut choices: Vec<_> = world.ready().collect();
        if late >= TICKS_PER_MS.into() {
            choices.push(Choice::Poll);
        }
        if late < LATEST_POLL_TICKS {
            choices.extend([Choice::Tick].repeat(ticks_per_choice));
        }
        if world.schedule.len() > MOST_CHOICES {
            return Err("a request is never done".to_owned());
        }
        let choice = choices[chance.below(choices.len())];
        if chance.below(60) == 0 {
            world.moves();
        }
        world.go_on(choice)?;
    }
    world.end()?;
    world.plays_again()
}

/// Explores pairs of the first requests, one per host: those that `take` says of the pairs each once, because the hosts
/// are alike.
fn explore_pairs(
    mistake: Mistake,
    waits: u32,
    mut take: impl FnMut(usize, usize) -> bool,
) -> Result<usize, String> {
    let beginning = Beginning::new(true);
    let mut states = 0;
    for (one, first) in REQUESTS[..PAIRED].iter().enumerate() {
        for (other, second) in REQUESTS[..PAIRED].iter().enumerate().skip(one) {
            if !take(one, other) {
                continue;
            }
            for plays in [false, true] {
                let scenario = Scenario {
                    beginning: &beginning,
                    lists: [&[*first], &[*second]],
                    plays,
                    mistake,
                };
                states += scenario.explore(waits)?;
            }
        }
    }
    Ok(states)
}

#[test]
fn every_schedule_of_every_pair_of_requests_keeps_the_rules() {
    let mut chance = Chance::new(budget::seed(), 0);
    let states = explore_pairs(NONE, WAITS, |_, _| chance.is_drawn());
    let states = states.unwrap_or_else(|problem| panic!("{problem}"));
    assert!(states > 200, "{states}");
}

#[test]
fn every_schedule_of_drawn_triples_of_requests_keeps_the_rules() {
    let beginning = Beginning::new(true);
    for case in 0..u64::from(budget::cases(12)) {
        let mut chance = Chance::new(!budget::seed(), case);
        let [one, other] = [chance.below(PAIRED), chance.below(PAIRED)];
        let third = chance.below(REQUESTS.len());
        let scenario = Scenario {
            beginning: &beginning,
            lists: [&[REQUESTS[one], REQUESTS[other]], &[REQUESTS[third]]],
            plays: chance.below(2) == 0,
            mistake: NONE,
        };
        if let Err(problem) = scenario.explore(WAITS) {
            let seed = budget::seed();
            panic!("with STYLUS_ATTACK_SEED={seed}, case {case}: {problem}");
        }
    }
}

#[test]
fn the_check_finds_a_play_that_comes_while_a_setting_is_stored() {
    // Playing is not locked meanwhile.
    let unlock: Mistake = |control| control.end_self_test();
    let found = explore_pairs(unlock, WAITS, |_, _| true);
    let found = found.expect_err("the lock is left out");
    assert!(found.contains("setting"), "{found}");
    assert!(
        found.contains("play") && found.contains("set a limit"),
        "{found}"
    );
}

#[test]
fn the_check_finds_a_device_that_stays_locked() {
    let lock: Mistake = |control| {
        let _ = control.begin_self_test();
    };
    let found = explore_pairs(lock, 1, |one, other| one == other);
    assert!(found.is_err(), "{found:?}");
}

#[test]
fn random_schedules_of_many_requests_keep_the_rules() {
    let beginnings = [true, false].map(Beginning::new);
    for case in 0..u64::from(budget::cases(1_500)) {
        let mut chance = Chance::new(budget::seed(), case);
        let lists: [Vec<Request>; 2] = [(); 2].map(|()| {
            let length = 1 + chance.below(7);
            let draw = |_| {
                // Half of them of the first ones.
                let among = [PAIRED, REQUESTS.len()][chance.below(2)];
                REQUESTS[chance.below(among)]
            };
            (0..length).map(draw).collect()
        });
        let scenario = Scenario {
            beginning: &beginnings[chance.below(2)],
            lists: [&lists[0], &lists[1]],
            plays: chance.below(2) == 0,
            mistake: NONE,
        };
        let wandered = scenario.wander(&mut chance);
        if let Err(problem) = wandered {
            let seed = budget::seed();
            panic!("with STYLUS_ATTACK_SEED={seed}, case {case}: {problem}");
        }
    }
}
