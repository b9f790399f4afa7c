//! Interleavings of the requests of two hosts on two links, which do not wait for answers, with the storage's task, the
//! poll and the tick.
//!
//! The application is the device's own, on the shared fake hardware. At each await, an executor chooses at random which
//! task continues; ticks and polls are late by up to a millisecond. [`REQUESTS`] is the list of requests. A new request
//! is covered by a line in this list, and a new await is covered without any change, because the executor chooses at
//! every await.
//!
//! Checked at each point: what `Watch` in `world.rs` looks at. Checked at the end: every request was answered once, and
//! the device plays again.

mod list;
mod world;

use fake_stylus::hardware::Hardware;
use stylus_app::TICKS_PER_MS;
use stylus_app::control::{Control, Device};

use crate::budget::{self, Chance};
use list::{FIRST, REQUESTS, Request};
use world::{Beginning, Checked, Choice, LATEST_POLL_TICKS, World};

/// Number of choices of a schedule after which it counts as endless.
const MOST_CHOICES: usize = 200_000;

/// A mistake made after each step of the storage, to show that the check would notice it.
pub type Mistake = fn(&mut Control<Hardware>);

/// Nothing goes wrong.
const NONE: Mistake = |_| ();

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

/// Runs `cases` random schedules of up to `most` requests of each host.
fn run(cases: u32, most: usize, mistake: Mistake) -> Checked {
    let beginnings =
        [(true, false), (false, false), (false, true)].map(|(brief, on_trial)| Beginning::new(brief, on_trial));
    for case in 0..u64::from(budget::cases(cases)) {
        let mut chance = Chance::new(budget::seed(), case);
        let lists: [Vec<Request>; 2] = [(); 2].map(|()| {
            let length = 1 + chance.below(most);
            let draw = |_| {
                // Half of the requests are chosen from the first ones only.
                let among = [FIRST, REQUESTS.len()][chance.below(2)];
                REQUESTS[chance.below(among)].clone()
            };
            (0..length).map(draw).collect()
        });
        let beginning = &beginnings[chance.below(beginnings.len())];
        let plays = chance.below(2) == 0;
        let mut world = World::new(beginning, [&lists[0], &lists[1]], plays, mistake);
        wander(&mut world, &mut chance).map_err(|problem| {
            let names = lists.map(|list| list.iter().map(|request| request.name).collect::<Vec<_>>());
            let seed = budget::seed();
            let schedule = &world.schedule;
            format!("with STYLUS_ATTACK_SEED={seed}, case {case}: {problem}\n{names:?}, {plays}, {schedule:?}")
        })?;
    }
    Ok(())
}

#[test]
fn schedules_of_few_and_of_many_requests_keep_the_rules() {
    for (cases, most) in [(2_000, 2), (1_500, 7)] {
        run(cases, most, NONE).unwrap_or_else(|problem| panic!("{problem}"));
    }
}

#[test]
fn the_check_finds_a_play_that_comes_while_a_setting_is_stored_and_a_device_that_stays_locked() {
    // The mistake: playing is not prevented meanwhile.
    let found = run(10_000, 2, Control::end_self_test).expect_err("the lock is left out");
    assert!(found.contains("setting"), "{found}");
    assert!(found.contains("play"), "{found}");
    let found = run(10_000, 2, |control| {
        let _ = control.begin_self_test();
    });
    assert!(found.is_err(), "{found:?}");
}
