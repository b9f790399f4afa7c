//! Instructions per tick of each effect of a scene, compared with the kernel's model of the cost.

use std::collections::BTreeSet;

use model_format::scene::limits::MAX_RESPONSE_SECTIONS;
use stylus_app::UPDATE_LEAD_TICKS;
use stylus_kernel::scene::cost::{self, StageCost};
use virtual_stylus::tick::Tick;

use crate::device::{Device, MS, PERIOD_NS};
use crate::scenes::{ORDERS, bytes, press};
use crate::{library, play};

/// Largest number of instructions by which a tick of a fed lattice may exceed a tick of a plain one.
const MOST_FED: u32 = 40;

/// Instructions per tick over some milliseconds. `within`: ticks that neither begin a block nor request one, which are
/// all equal. `beginning`: the maximum of the other ticks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Count {
    pub within: u32,
    pub beginning: u32,
    /// The different counts among the ticks that begin or request a block.
    pub kinds: BTreeSet<u32>,
}

/// Counts the instructions per tick over `millis` milliseconds.
pub fn count(device: &mut Device, what: &str, millis: u64) -> Count {
    let ticks = ticks(device, millis);
    let beginning = |tick: &&Tick| hands_over(&ticks, tick);
    let within: Vec<u32> = ticks
        .iter()
        .filter(|tick| !beginning(tick))
        .map(|tick| tick.instructions)
        .collect();
    let others: BTreeSet<u32> = ticks.iter().filter(beginning).map(|tick| tick.instructions).collect();
    let count = Count {
        within: within[0],
        beginning: *others.last().expect("blocks begin"),
        kinds: others,
    };
    let uneven = within.iter().find(|&&one| one != count.within);
    assert_eq!(uneven, None, "{what}: {count:?}");
    println!("instructions a tick, {what}: {} / {}", count.within, count.beginning);
    count
}

fn ticks(device: &mut Device, millis: u64) -> Vec<Tick> {
    device.stylus.take_ticks();
    device.run_for(millis * MS);
    device.stylus.take_ticks()
}

/// Returns true if `tick` begins a block or requests the next block. In every ten ticks there is one of each kind, and
/// both take more instructions than the other eight.
fn hands_over(ticks: &[Tick], tick: &Tick) -> bool {
    let of_period = |tick: &Tick| (tick.at_ns + PERIOD_NS / 2) / PERIOD_NS % 10;
    let mut fewest = [u32::MAX; 10];
    for tick in ticks {
        let fewest = &mut fewest[of_period(tick) as usize];
        *fewest = tick.instructions.min(*fewest);
    }
    let least = fewest.iter().min().expect("there are ten");
    let more: Vec<usize> = (0..10).filter(|&place| fewest[place] > *least).collect();
    let lead = UPDATE_LEAD_TICKS as usize;
    let apart = more.last().zip(more.first()).map(|(last, first)| last - first);
    assert!(
        more.len() == 2 && apart.is_some_and(|apart| [lead, 10 - lead].contains(&apart)),
        "{fewest:?}"
    );
    more.contains(&(of_period(tick) as usize))
}

/// Plays `scene`, and counts while it sounds.
pub fn count_scene(device: &mut Device, scene: &str) -> Count {
    device.play_scene(scene, 3);
    // The plan is exchanged in this time.
    device.run_for(200 * MS);
    count(device, scene, 30)
}

/// Plays `scene`, lifts the tool, strikes, and counts while the tap rings.
fn count_struck(device: &mut Device, scene: &str) -> Count {
    device.play_scene(scene, 3);
    press(device, 0.0);
    device.run_for(20 * MS);
    press(device, 1.0);
    device.run_for(20 * MS);
    count(device, &format!("{scene}, struck"), 30)
}

/// Checks that the model's cost for `each` is at least what was measured, and exceeds it by at most 5 % and 8
/// instructions.
fn covers(model: StageCost, each: u32, measured: u32) {
    let modelled = u32::from(model.base) + u32::from(model.each) * each;
    assert!(
        (measured..=measured + measured / 20 + 8).contains(&modelled),
        "{model:?} is {modelled} for {each}, and {measured} are measured"
    );
}

/// A device with all scenes, whose tool is pressed on the surface and moves.
fn rubbing() -> Device {
    let mut device = Device::started(library::with(&bytes()));
    press(&mut device, 1.0);
    device.move_at(20.0);
    device
}

#[test]
fn an_effect_costs_a_tick_what_the_model_says_and_one_that_is_not_called_for_nothing() {
    let mut device = rubbing();
    let idle = count(&mut device, "idle", 20).within;
    device.play_until_heard("lattice");
    let texture = count(&mut device, "texture", 30);
    let lattice = count_lattice(&mut device);
    assert_same(&texture, &lattice, "a scene of one surface is its texture");
    for scene in ["lattice", "constant", "tap", "away from the transition"] {
        assert_same(&count_scene(&mut device, scene), &lattice, scene);
    }
    let lattice = lattice.within;
    let mut of = |scene| count_scene(&mut device, scene).within;
    let [short, transition, sticky_transition, sticky] =
        ["short lattice", "transition", "sticky transition", "sticky"].map(&mut of);
    let [one, four, eight] = ["one section", "four sections", "eight sections"].map(&mut of);
    let [one_line, four_lines] = ["one line", "four lines"].map(&mut of);
    let [fed, short_fed] = ["fed", "short fed"].map(&mut of);
    let [two_fed, beside] = ["fed transition", "fed beside plain"].map(&mut of);
    let tap = count_struck(&mut device, "tap").within;
    let both = count_struck(&mut device, "tap, four sections").within;

    // The first voice's instructions include those of the mix, which two voices share.
    // The two textures together have one mix and one idle tick more than their transition.
    let mix = lattice + short - transition - idle;
    let of_voice = |played: u32| played - idle - mix;
    for (model, each, measured) in [
        (cost::MIX, 0, mix),
        (cost::LATTICE, ORDERS[0], of_voice(lattice)),
        (cost::LATTICE, ORDERS[1], of_voice(short)),
        (cost::STICK_SLIP, 0, sticky - lattice),
        (cost::LINES, 1, one_line - lattice),
        (cost::LINES, 4, four_lines - lattice),
        (cost::TAP, 0, tap - lattice),
        (cost::EQUALISER, 1, one - lattice),
        (cost::EQUALISER, 4, four - lattice),
        (cost::EQUALISER, 8, eight - lattice),
        // The excitation of a fed voice is computed outside of the tick. Reading it takes a few instructions more, but
        // no noise is generated in the tick.
        (cost::FED_LATTICE, ORDERS[0], of_voice(fed)),
        (cost::FED_LATTICE, ORDERS[1], of_voice(short_fed)),
    ] {
        covers(model, each, measured);
    }
    assert!(four_lines - lattice <= 200, "{four_lines}");
    assert!(fed.saturating_sub(lattice) <= MOST_FED, "{fed}, {lattice}");
    // The cost of a stage does not depend on the other stages.
    assert_eq!(sticky_transition - transition, 2 * (sticky - lattice));
    assert_eq!(both - four, tap - lattice);
    assert_eq!(two_fed, fed + of_voice(short_fed));
    assert_eq!(beside, lattice + of_voice(short_fed));

    assert_no_contact_costs_the_mix_at_most(&mut device, idle);
    covers(cost::FADE_OUT, 0, fading(&mut device) - four);
    let (probing, equalised) = (probing(&mut device), equalised(&mut device));
    covers(cost::WAVE, 0, probing - idle - mix);
    let sections = 8 + MAX_RESPONSE_SECTIONS as u32;
    covers(cost::EQUALISER, sections, equalised - lattice);
    device.assert_undisturbed();
}

/// Counts a lattice without effects in both kinds of blocks: those that begin a frame, because the motion has changed,
/// and those that play the frame before on. The encoder's counts beat with the ticks, so the speed that follows from
/// them may do either for hundreds of milliseconds. So there are three counts: for the tick that requests the update,
/// and for the tick that begins a block of either kind, whichever block it is.
fn count_lattice(device: &mut Device) -> Count {
    let resting = count_scene(device, "constant");
    device.play_scene("lattice", 3);
    device.run_for(200 * MS);
    device.move_at(30.0);
    let mut all = count(device, "lattice, accelerating", 30);
    device.move_at(20.0);
    device.run_for(200 * MS);
    assert_eq!(resting.kinds.len(), 2, "{resting:?}");
    all.kinds.extend(resting.kinds);
    assert_eq!((all.kinds.len(), all.within), (3, resting.within), "{all:?}");
    all
}

/// Checks that a tick of `count` takes the instructions of one of `lattice`.
fn assert_same(count: &Count, lattice: &Count, what: &str) {
    let is_same = count.within == lattice.within && count.kinds.is_subset(&lattice.kinds);
    assert!(is_same, "{what}: {count:?}, and {lattice:?}");
}

/// Without contact the list of stages is empty: neither noise nor filter runs.
fn assert_no_contact_costs_the_mix_at_most(device: &mut Device, idle: u32) {
    device.play_scene("eight sections", 3);
    press(device, 0.0);
    device.run_for(200 * MS);
    let lifted = count(device, "lifted", 20).within;
    assert!(
        lifted - idle <= u32::from(cost::MIX.base),
        "{lifted} lifted, {idle} idle"
    );
}

/// Instructions of a tick in which a scene of four sections fades out. The fade lasts one block, in which the plan is
/// exchanged.
fn fading(device: &mut Device) -> u32 {
    press(device, 1.0);
    device.play_scene("four sections", 3);
    device.run_for(30 * MS);
    device.play_scene("lattice", 3);
    let after = ticks(device, 20);
    let fading = after
        .iter()
        .filter(|tick| !hands_over(&after, tick))
        .map(|tick| tick.instructions)
        .max()
        .expect("there are ticks");
    println!("instructions a tick, four sections, fading: {fading}");
    fading
}

/// Instructions of a tick that plays a probe. It only reads the probe's samples.
fn probing(device: &mut Device) -> u32 {
    device.stop();
    device.run_for(100 * MS);
    let wave = play::load(device);
    play::start(device, wave);
    device.run_for(50 * MS);
    count(device, "probe", 30).within
}

/// Instructions of a tick with all sections of a response, which run after the scene's own eight sections.
fn equalised(device: &mut Device) -> u32 {
    device.stop();
    device.run_for(100 * MS);
    play::store(device, MAX_RESPONSE_SECTIONS);
    device.run_for(20 * MS);
    count_scene(device, "eight sections").within
}
