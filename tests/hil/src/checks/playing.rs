//! Playing by both sources of motion, the stop, and the mutes.

use model_format::link::{
    Activity, MotionSource, MuteReason, Selection, Setting, SettingChange, SettingsError, Status,
};
use stylus_link::link::LinkError;
use stylus_link::procedures::self_test::Line;

use crate::bench::{DeviceUnderTest, is_playing, request};
use crate::library;
use crate::report::{Error, Result};

/// Longest time from the cause of a mute until the output is at mid-scale, ms.
const SILENT_WITHIN_MS: u64 = 100;

/// Checks what a person would feel, and that it ends.
pub fn check(bench: &mut DeviceUnderTest, scene: &Selection) -> Result<()> {
    from_the_host(bench, scene)?;
    stop(bench)?;
    from_the_sensors(bench)?;
    stale(bench)?;
    lost_link(bench)
}

fn from_the_host(bench: &mut DeviceUnderTest, scene: &Selection) -> Result<()> {
    let length = bench.lengths.play_ms;
    let before = bench.status()?;
    let played = bench.while_playing(&library::dearest(), MotionSource::Host, |bench| {
        let heard = bench.wait_until_heard()?;
        let setting = Setting::SoftStart;
        let value = setting.spec().default;
        let refusal = bench.device.set(SettingChange { setting, value });
        bench.wait(length)?;
        bench.device.play(&request(scene, MotionSource::Host))?;
        let taken = bench.wait_until("the scene did not take over", 2_000, |status| {
            plays(status, scene) && status.output.mute.is_empty()
        })?;
        Ok((heard, refusal, taken))
    })?;
    let ((heard, refusal, after), driven) = played;
    bench.judge(
        "plays along the host's motion",
        format!("{} motions, {} acknowledged", driven.motions, driven.acknowledged),
        "playing from the host, not muted",
        matches!(
            heard.output.activity,
            Activity::Playing {
                motion: MotionSource::Host,
                ..
            }
        ),
    );
    let refused = matches!(&refusal, Err(LinkError::Settings(SettingsError::Playing)));
    let refusal = refusal.map_or_else(|error| error.to_string(), |_| "taken".to_owned());
    bench.judge("settings are refused while it plays", refusal, "refused", refused);
    bench.judge(
        "a scene takes over from a texture",
        format!("{:?}", after.output.activity),
        "the scene, not muted",
        plays(&after, scene),
    );
    on_time(bench, &before, &after);
    Ok(())
}

/// Returns true if `selection` is playing, muted or not.
fn plays(status: &Status, selection: &Selection) -> bool {
    matches!(&status.output.activity, Activity::Playing { selection: played, .. } if played == selection)
}

/// Adds a line for each of the tick's counters, with its increase from `before` to `after`.
fn on_time(bench: &mut DeviceUnderTest, before: &Status, after: &Status) {
    let counts = |status: &Status| {
        let tick = status.tick;
        [
            ("missed ticks", tick.missed),
            ("late blocks", tick.late_frames),
            ("late conversions", tick.late_conversions),
            ("late outputs", tick.late_outputs),
        ]
    };
    for ((name, before), (_, after)) in counts(before).into_iter().zip(counts(after)) {
        bench.add(Line::none(name, after.saturating_sub(before), ""));
    }
}

fn stop(bench: &mut DeviceUnderTest) -> Result<()> {
    let play = library::cheap();
    let ((before, after), _) = bench.while_playing(&play, MotionSource::Host, |bench| {
        bench.wait_until_heard()?;
        let before = bench.status()?;
        // Waits until the output is idle.
        bench.device.stop()?;
        Ok((before, bench.status()?))
    })?;
    let took = after.uptime_ms.saturating_sub(before.uptime_ms);
    bench.judge(
        "stop ends at mid-scale",
        format!("within {took} ms, the link's time included"),
        "idle, at mid-scale, 100 ms",
        after.output.activity == Activity::Idle && after.output.at_rest && took <= SILENT_WITHIN_MS,
    );
    Ok(())
}

fn from_the_sensors(bench: &mut DeviceUnderTest) -> Result<()> {
    let name = "plays along the sensors";
    let play = library::cheap();
    let length = bench.lengths.play_ms;
    let (status, _) = bench.while_playing(&play, MotionSource::Sensors, |bench| {
        // Waits until the player has seen the sensors. An emulator on a late host needs longer.
        let status = bench.wait(length)?;
        match bench.wait_until_heard() {
            Ok(heard) => Ok(heard),
            Err(Error::NotReached { .. }) => Ok(status),
            Err(error) => Err(error),
        }
    })?;
    let mute = status.output.mute;
    if mute.contains(MuteReason::Stale) || mute.contains(MuteReason::ForceRail) {
        let reason = "the sensors are not connected or at a rail: connect encoder and force sensor";
        bench.leave_out(name, reason);
        return Ok(());
    }
    bench.judge(
        name,
        format!("{:?}, muted: [{}]", status.output.activity, status.output.mute),
        "playing, not muted",
        is_playing(&status) && status.output.mute.is_empty(),
    );
    Ok(())
}

/// Sends neither motions nor keep-alives. The output must fade, and the status must name the motion that became stale,
/// beside the lost link.
fn stale(bench: &mut DeviceUnderTest) -> Result<()> {
    let play = library::cheap();
    // Shows first that the same play is heard while motions come.
    bench.while_playing(&play, MotionSource::Host, DeviceUnderTest::wait_until_heard)?;
    bench.device.play(&request(&play, MotionSource::Host))?;
    let status = bench.wait_until("an old motion did not mute", 2_000, |status| {
        status.output.mute.contains(MuteReason::Stale) && status.output.at_rest
    });
    bench.device.stop()?;
    let status = status?;
    bench.judge(
        "an old motion mutes",
        format!("muted: {}", status.output.mute),
        "at mid-scale, speed or force out of date",
        is_playing(&status),
    );
    Ok(())
}

/// Sends nothing that renews the lease, and reads the status until the output is at mid-scale.
fn lost_link(bench: &mut DeviceUnderTest) -> Result<()> {
    /// Number of attempts to read in time, because this computer's clock is not the device's.
    const ATTEMPTS: u32 = 40;
    let play = library::cheap();
    let name = "a lost link is silent within 100 ms";
    for _ in 0..ATTEMPTS {
        bench.device.play(&request(&play, MotionSource::Host))?;
        let heard = bench.heard_with_motions()?;
        let gap = |status: &Status| status.uptime_ms.saturating_sub(heard.uptime_ms);
        let mut after = bench.status()?;
        while !after.output.at_rest && gap(&after) < SILENT_WITHIN_MS {
            after = bench.status()?;
        }
        bench.device.stop()?;
        let gap = gap(&after);
        let [before, lost] = [&heard, &after].map(|status| count(status, MuteReason::LinkLost));
        // An output that was found at rest too late says nothing: this computer may have paused meanwhile.
        if after.output.at_rest && gap > SILENT_WITHIN_MS {
            continue;
        }
        let value = format!(
            "at mid-scale: {}, after {gap} ms, lost {} times",
            after.output.at_rest,
            lost - before
        );
        let limits = "at mid-scale after at most 100 ms, link lost counted";
        bench.judge(name, value, limits, after.output.at_rest && lost > before);
        return Ok(());
    }
    let reason = "this computer read the output too late each time: end other programs";
    bench.leave_out(name, reason);
    Ok(())
}

/// Number of times that `reason` has muted the output.
pub fn count(status: &Status, reason: MuteReason) -> u32 {
    let index = MuteReason::ALL.iter().position(|&one| one == reason);
    index.map_or(0, |index| status.output.mute_counts[index])
}
