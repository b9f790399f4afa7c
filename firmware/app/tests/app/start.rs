//! Decisions at a start, from runs of any length and any end.

use model_format::link::{ClockSource, QUICK_FAULTS, StartStage};
use proptest::prelude::*;
use stylus_app::start::{Ended, Kept};

const FAULT: Ended = Ended::ByFault { clock_failed: false };
const CLOCK_FAILED: Ended = Ended::ByFault { clock_failed: true };

/// The record for the start after a run that reached `stage` and ended as `ended`.
fn after(before: Kept, stage: Option<StartStage>, healthy: bool, ended: Ended) -> Kept {
    let run = Kept {
        stage,
        healthy,
        ..before
    };
    Kept::from_word(run.to_word()).next(ended)
}

fn any_end() -> impl Strategy<Value = Ended> {
    prop_oneof![
        Just(Ended::ByHand),
        Just(Ended::ByWatchdog),
        Just(FAULT),
        Just(CLOCK_FAILED),
        Just(Ended::WithoutFault),
    ]
}

fn any_stage() -> impl Strategy<Value = Option<StartStage>> {
    prop::option::of(prop::sample::select(StartStage::ALL.to_vec()))
}

#[test]
fn an_external_clock_that_fails_is_not_used_again_until_the_power_comes_anew() {
    for healthy in [false, true] {
        let kept = after(Kept::default(), None, healthy, CLOCK_FAILED);
        assert_eq!(kept.clock, ClockSource::Internal);
        let later = after(kept, None, true, Ended::WithoutFault);
        assert_eq!(later.clock, ClockSource::Internal);
        let anew = after(later, None, true, Ended::ByHand);
        assert_eq!(anew.clock, ClockSource::External);
    }
}

#[test]
fn a_clock_that_hangs_leads_to_the_next_source_and_the_last_one_to_safe_mode() {
    let (external, internal) = (StartStage::ExternalClock, StartStage::InternalClock);
    let first = after(Kept::default(), Some(external), false, Ended::ByWatchdog);
    assert_eq!(first.clock, ClockSource::Internal);
    assert_eq!(first.hung_stage, Some(external));
    assert!(!first.safe_mode);
    let second = after(first, Some(internal), false, Ended::ByWatchdog);
    assert_eq!(second.clock, ClockSource::InternalUnmultiplied);
    assert_eq!(second.hung_stage, Some(internal));
    assert!(second.safe_mode);
}

proptest! {
    #[test]
    fn only_a_person_leads_out_of_safe_mode_or_back_to_a_better_clock(
        runs in prop::collection::vec((any_stage(), any::<bool>(), any_end()), 1..40),
    ) {
        let mut kept = Kept::default();
        for (stage, healthy, ended) in runs {
            let next = after(kept, stage, healthy, ended);
            if ended == Ended::ByHand {
                prop_assert_eq!(next, Kept::default());
            } else {
                prop_assert!(next.safe_mode || !kept.safe_mode);
                prop_assert!(next.clock as u8 >= kept.clock as u8);
                prop_assert!(next.quick_faults <= kept.quick_faults.saturating_add(1));
            }
            prop_assert_eq!(next.stage, None);
            prop_assert!(!next.healthy);
            kept = next;
        }
    }

    #[test]
    fn faults_reach_safe_mode_whatever_lies_between_but_a_healthy_run(
        runs in prop::collection::vec((any::<bool>(), prop::bool::weighted(0.2)), 0..40),
    ) {
        let mut kept = Kept::default();
        let mut faults = 0;
        let mut safe_mode = false;
        for (fault, healthy) in runs {
            kept = after(kept, None, healthy, if fault { FAULT } else { Ended::WithoutFault });
            faults = if healthy { 0 } else { faults + u32::from(fault) };
            safe_mode |= faults >= u32::from(QUICK_FAULTS);
            prop_assert_eq!(kept.safe_mode, safe_mode);
        }
    }

    #[test]
    fn a_word_keeps_all_of_it(
        quick_faults: u8,
        healthy: bool,
        safe_mode: bool,
        stage in any_stage(),
        hung_stage in any_stage(),
        clock in prop::sample::select(vec![
            ClockSource::External,
            ClockSource::Internal,
            ClockSource::InternalUnmultiplied,
        ]),
    ) {
        let kept = Kept { quick_faults, healthy, safe_mode, clock, stage, hung_stage };
        prop_assert_eq!(Kept::from_word(kept.to_word()), kept);
    }

    #[test]
    fn any_noise_is_some_knowledge(word: u32) {
        let kept = Kept::from_word(word);
        prop_assert_eq!(Kept::from_word(kept.to_word()), kept);
    }
}
