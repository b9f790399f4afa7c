//! Colours of pictures on light paper, and the colours in which a dark screen shows the same pictures.
//!
//! A picture is written with the light colours, which every program draws. A style inside the picture replaces them by
//! dark colours where the reader prefers a dark scheme, but only on screens; paper stays white. In a map, the style
//! also reverses the scale of colours. The colours of a spectrogram are the same in both schemes.

use plotters::style::RGBColor;

/// Colours after Okabe and Ito, which any colour vision can distinguish. Some are darker than the originals, because a
/// line needs a contrast of at least 3 to 1 on white (WCAG 2.1, 1.4.11).
pub const BLUE: RGBColor = RGBColor(0, 94, 162);
/// See [`BLUE`].
pub const VERMILION: RGBColor = RGBColor(213, 94, 0);
/// See [`BLUE`].
pub const GREEN: RGBColor = RGBColor(0, 140, 102);
/// See [`BLUE`].
pub const PURPLE: RGBColor = RGBColor(184, 92, 144);
/// See [`BLUE`].
pub const ORANGE: RGBColor = RGBColor(176, 122, 0);
/// See [`BLUE`].
pub const SKY: RGBColor = RGBColor(62, 148, 201);
/// Text that must not be overlooked.
pub const ALERT: RGBColor = RGBColor(179, 71, 0);
/// Text and axes.
pub const INK: RGBColor = RGBColor(40, 40, 40);
/// Text and marks on a colour that is pale in both schemes.
pub const ON_PALE: RGBColor = RGBColor(41, 41, 41);
/// Paper, and text on a dark cell.
const WHITE: RGBColor = RGBColor(255, 255, 255);
/// Mesh lines, and cells without a value.
pub const PALE: RGBColor = RGBColor(225, 225, 225);
/// Curves of models, which are less important than those of signals.
pub const FADED: RGBColor = RGBColor(130, 130, 130);

/// The background of a dark screen, the same as that of a page.
pub const DARK_GROUND: RGBColor = RGBColor(22, 24, 26);

/// Colours of series, in their order.
pub const SERIES: [RGBColor; 6] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY];

/// Light colours with their replacements on a dark screen. Replacements of [`pale`] colours are derived from them.
const DARK: [(RGBColor, RGBColor); 10] = [
    (ALERT, RGBColor(255, 156, 87)),
    (INK, RGBColor(232, 232, 232)),
    (PALE, RGBColor(62, 66, 70)),
    (FADED, RGBColor(150, 150, 150)),
    (BLUE, RGBColor(64, 150, 224)),
    (VERMILION, RGBColor(255, 138, 61)),
    (GREEN, RGBColor(47, 194, 152)),
    (PURPLE, RGBColor(230, 155, 200)),
    (ORANGE, RGBColor(240, 190, 50)),
    (SKY, RGBColor(150, 212, 247)),
];

/// Returns a colour two thirds of the way to white, so that marks drawn over it stand out.
pub fn pale(RGBColor(r, g, b): RGBColor) -> RGBColor {
    let lighter = |c: u8| 255 - (255 - c) / 3;
    RGBColor(lighter(r), lighter(g), lighter(b))
}

/// Returns a colour two thirds of the way to a dark screen's background, like [`pale`] on white.
fn dim(RGBColor(r, g, b): RGBColor) -> RGBColor {
    let RGBColor(ground_r, ground_g, ground_b) = DARK_GROUND;
    let darker = |c: u8, ground: u8| ground + c.saturating_sub(ground) / 3;
    RGBColor(darker(r, ground_r), darker(g, ground_g), darker(b, ground_b))
}

/// Number of colours of a map's scale.
pub const SHADES: usize = 49;

/// Returns a colour of a map's scale, from pale at zero to dark at the largest value. Passing through the palette's
/// blue makes the scale perceptually even.
pub fn shade(step: usize) -> RGBColor {
    const STOPS: [RGBColor; 3] = [RGBColor(247, 247, 247), RGBColor(91, 163, 207), RGBColor(8, 48, 107)];
    between(&STOPS, step as f64 / (SHADES - 1) as f64)
}

/// Returns the colour at the fraction `share`, 0 to 1, of the way along `stops`.
pub fn between(stops: &[RGBColor], share: f64) -> RGBColor {
    let place = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
    // The end itself belongs to the last interval.
    let below = (place as usize).min(stops.len() - 2);
    let (RGBColor(r, g, b), RGBColor(to_r, to_g, to_b)) = (stops[below], stops[below + 1]);
    let mix = |from: u8, to: u8| {
        let part = place - below as f64;
        (f64::from(from) + (f64::from(to) - f64::from(from)) * part).round() as u8
    };
    RGBColor(mix(r, to_r), mix(g, to_g), mix(b, to_b))
}

/// Returns a colour in the notation of SVG and CSS.
pub fn hex(RGBColor(r, g, b): RGBColor) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

/// Returns the style rules that show a picture in its dark colours.
pub fn dark_style() -> String {
    let pales = SERIES.map(|series| (pale(series), dim(in_the_dark(series))));
    let (white, ground) = (hex(WHITE), hex(DARK_GROUND));
    let ground = format!(".plot rect[fill='{white}']{{fill:{ground}}}");
    style_of(DARK.into_iter().chain(pales), &ground)
}

/// Returns the style rules that show a map in its dark colours, in addition to those of every picture. A scale then
/// begins near the background, so that the lowest values, and thus the best costs, are as inconspicuous as on paper.
/// Text and marks on a cell change with it.
pub fn dark_scale_style() -> String {
    let shades = (0..SHADES).map(|step| (shade(step), shade(SHADES - 1 - step)));
    let on_cells = [(ON_PALE, WHITE), (WHITE, ON_PALE)].map(|(light, dark)| {
        let (light, dark) = (hex(light), hex(dark));
        format!(
            ".plot text[fill='{light}'],.plot polygon[fill='{light}']{{fill:{dark}}}\
             .plot polyline[stroke='{light}']{{stroke:{dark}}}"
        )
    });
    style_of(shades, &on_cells.concat())
}

/// Returns rules that replace light colours by dark ones on a dark screen, followed by `others`. They use single
/// quotes, because attributes use double quotes.
fn style_of(pairs: impl Iterator<Item = (RGBColor, RGBColor)>, others: &str) -> String {
    let rules = pairs.map(|(light, dark)| {
        let (light, dark) = (hex(light), hex(dark));
        format!(".plot [fill='{light}']{{fill:{dark}}}.plot [stroke='{light}']{{stroke:{dark}}}")
    });
    format!(
        "@media screen and (prefers-color-scheme:dark){{{others}{}}}",
        rules.collect::<String>()
    )
}

/// Returns the dark replacement of `light`, or `light` itself if there is none.
pub fn in_the_dark(light: RGBColor) -> RGBColor {
    let pair = DARK.iter().find(|pair| pair.0 == light);
    pair.map_or(light, |pair| pair.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the contrast of two colours by WCAG 2.1, 1 to 21.
    fn contrast(a: RGBColor, b: RGBColor) -> f64 {
        let luminance = |RGBColor(r, g, b): RGBColor| {
            let linear = |c: u8| {
                let c = f64::from(c) / 255.0;
                if c <= 0.04045 {
                    c / 12.92
                } else {
                    ((c + 0.055) / 1.055).powf(2.4)
                }
            };
            0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
        };
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn lines_and_text_have_contrast_on_light_and_on_dark_ground() {
        let white = WHITE;
        for series in SERIES.into_iter().chain([FADED]) {
            assert!(contrast(series, white) >= 3.0, "{series:?}");
            assert!(contrast(in_the_dark(series), DARK_GROUND) >= 3.0, "{series:?}");
        }
        for ground in SERIES.map(pale).into_iter().chain([white, PALE]) {
            assert!(contrast(INK, ground) >= 4.5, "{ground:?}");
            assert!(contrast(VERMILION, ground) >= 2.0, "{ground:?}");
        }
        assert!(contrast(ALERT, white) >= 4.5);
        assert!(contrast(in_the_dark(ALERT), DARK_GROUND) >= 4.5);
        let dims = SERIES.map(|series| dim(in_the_dark(series)));
        let grounds = [DARK_GROUND, in_the_dark(PALE)];
        for ground in dims.into_iter().chain(grounds) {
            assert!(contrast(in_the_dark(INK), ground) >= 4.5, "{ground:?}");
        }
    }

    #[test]
    fn a_scale_begins_near_the_ground_in_light_and_in_dark() {
        for (ground, step) in [(WHITE, 0), (DARK_GROUND, SHADES - 1)] {
            assert!(contrast(shade(step), ground) < 1.7, "{ground:?}");
            assert!(contrast(shade(SHADES - 1 - step), ground) > 10.0, "{ground:?}");
        }
        for step in 0..SHADES {
            let (light, dark) = (hex(shade(step)), hex(shade(SHADES - 1 - step)));
            assert!(dark_scale_style().contains(&format!("[fill='{light}']{{fill:{dark}}}")));
        }
    }

    #[test]
    fn every_colour_of_a_series_has_one_of_its_own_in_the_dark() {
        let dark: std::collections::BTreeSet<String> = SERIES.iter().map(|series| hex(in_the_dark(*series))).collect();
        assert_eq!(dark.len(), SERIES.len());
        for series in SERIES {
            assert_ne!(in_the_dark(series), series);
            assert!(dark_style().contains(&format!("[fill='{}']", hex(series))));
            assert!(dark_style().contains(&format!("[fill='{}']", hex(pale(series)))));
        }
        // Either of these characters would end the style.
        assert!(!dark_style().contains(['<', '"']));
    }
}
