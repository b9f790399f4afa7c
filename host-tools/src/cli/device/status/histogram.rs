//! Histogram of the tick's execution time, as text.

use model_format::link::{TICK_BIN_COUNT, TICK_BIN_CYCLES, TickHistogram};

/// Width of the longest bar, characters.
const WIDTH: f64 = 40.0;

/// Draws one line per bin that has ticks. Bars are in proportion to the logarithm, so that one tick in a million shows.
pub fn draw(histogram: &TickHistogram) -> String {
    let total: u64 = histogram.bins.iter().map(|&count| u64::from(count)).sum();
    if total == 0 || histogram.core_hz == 0 {
        return "no ticks yet".to_owned();
    }
    let microseconds = |cycles: u32| f64::from(cycles) * 1e6 / f64::from(histogram.core_hz);
    let most = histogram.bins.iter().max().copied().unwrap_or(1);
    let bar = |count: u32| {
        let share = f64::from(count).ln_1p() / f64::from(most).ln_1p();
        "#".repeat((share * WIDTH).round().max(1.0) as usize)
    };
    let mut text = format!(
        "{:.1} to {:.1} µs, {total} ticks",
        microseconds(histogram.shortest),
        microseconds(histogram.longest)
    );
    if histogram.bins.iter().filter(|count| **count > 0).count() == 1 {
        text.push_str(&format!(
            "\nall in one of the stylus's bins, which are {:.1} µs wide",
            microseconds(TICK_BIN_CYCLES)
        ));
        return text;
    }
    text.push_str(" (bars logarithmic)");
    let bins = histogram.bins.iter().enumerate();
    for (bin, &count) in bins.filter(|&(_, &count)| count > 0) {
        let from = microseconds(bin as u32 * TICK_BIN_CYCLES);
        let to = if bin + 1 == TICK_BIN_COUNT {
            "  and more".to_owned()
        } else {
            let to = microseconds((bin as u32 + 1) * TICK_BIN_CYCLES);
            format!("to {to:>6.1} µs")
        };
        text.push_str(&format!("\n{from:>6.1} {to}  {count:>10}  {}", bar(count)));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_that_tells_nothing_is_not_drawn() {
        let mut bins = [0; TICK_BIN_COUNT];
        bins[1] = 5000;
        let text = draw(&TickHistogram {
            core_hz: 400_000_000,
            shortest: 4100,
            longest: 8000,
            bins,
        });
        assert_eq!(
            text,
            "10.2 to 20.0 µs, 5000 ticks\nall in one of the stylus's bins, which are 10.2 µs wide"
        );
    }

    #[test]
    fn every_bin_that_has_ticks_is_drawn_and_the_fullest_is_the_longest() {
        let mut bins = [0; TICK_BIN_COUNT];
        (bins[1], bins[2], bins[TICK_BIN_COUNT - 1]) = (1000, 1_000_000, 1);
        let text = draw(&TickHistogram {
            core_hz: 400_000_000,
            shortest: 4100,
            longest: 90_000,
            bins,
        });
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4);
        assert!(
            lines[0].starts_with("10.2 to 225.0 µs, 1001001 ticks"),
            "{text}"
        );
        let length = |line: &str| line.matches('#').count();
        assert_eq!(length(lines[2]), 40);
        assert!(length(lines[1]) < 40 && length(lines[3]) >= 1);
        assert!(lines[3].contains("and more"));
    }
}
