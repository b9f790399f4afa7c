//! The parts that all pages share: one stylesheet with one set of colours, and the scripts that show a picture's values
//! and play sounds. And the one page that holds no result: the [`laboratory`], which makes them in a browser.

use plotters::style::RGBColor;

pub mod colours;
pub mod laboratory;

use colours::{BLUE, FADED, GREEN, INK, ORANGE, PALE, PURPLE, SKY, VERMILION, hex, in_the_dark};

/// Colours of pages as CSS variables: name, colour on light ground, colour on dark ground.
const PAGE: [(&str, &str, &str); 11] = [
    ("ground", "#fff", "#16181a"),
    ("ink", "#222", "#ececec"),
    ("quiet", "#4a4a4a", "#bdbdbd"),
    ("edge", "#cfcfcf", "#44494e"),
    ("strong", "#767676", "#8c8c8c"),
    ("accent", "#00568a", "#7cc4ee"),
    ("on-accent", "#fff", "#10202b"),
    ("soft", "#eef4f8", "#223038"),
    ("warn", "#fdf1e7", "#3a2413"),
    ("warn-edge", "#b34700", "#ff9c57"),
    ("shade", "#00000038", "#000000b0"),
];

/// Colours of pictures with the names of their CSS variables, for elements that a page draws itself.
const PICTURES: [(&str, RGBColor); 9] = [
    ("blue", BLUE),
    ("vermilion", VERMILION),
    ("green", GREEN),
    ("purple", PURPLE),
    ("orange", ORANGE),
    ("sky", SKY),
    ("mesh", PALE),
    ("faded", FADED),
    ("plot-ink", INK),
];

/// Returns the stylesheet of all pages: the colours as variables, light and dark, and the rules.
pub fn style() -> String {
    let pictures = PICTURES.map(|(name, own)| (name, hex(own), hex(in_the_dark(own))));
    let page = PAGE.map(|(name, light, dark)| (name, light.to_owned(), dark.to_owned()));
    let (mut light, mut dark) = (String::new(), String::new());
    for (name, on_light, on_dark) in page.into_iter().chain(pictures) {
        light += &format!(" --{name}: {on_light};");
        dark += &format!(" --{name}: {on_dark};");
    }
    format!(
        ":root {{ color-scheme: light dark;{light} }}\n\
         @media screen and (prefers-color-scheme: dark) {{\n  :root {{{dark} }}\n}}\n{}",
        include_str!("family.css")
    )
}

/// Returns a whole page with a content security policy. `title` and `body` are HTML, and `style` follows the common
/// stylesheet.
pub fn document(policy: &str, title: &str, style: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n\
         <style>\n{family}{style}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        family = self::style(),
    )
}

/// Returns the script that shows a picture's values on pointer, touch and keyboard input.
pub fn plots_script() -> String {
    let names = PICTURES.map(|(name, colour)| format!("\"{}\": \"--{name}\"", hex(colour)));
    include_str!("plots.js").replace("/*COLOURS*/", &names.join(", "))
}

/// Returns the script that plays nodes of maps and spectrograms. It requires [`plots_script`] before it.
pub fn players_script() -> &'static str {
    include_str!("players.js")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_variable_that_a_rule_uses_has_a_light_and_a_dark_colour() {
        let style = style();
        let (colours, rules) = style.split_once("* {").unwrap();
        let (light, dark) = colours.split_once("@media").unwrap();
        for used in rules.split("var(").skip(1) {
            let name = used.split(')').next().unwrap();
            let declared = format!(" {name}: #");
            assert!(light.contains(&declared), "{name}");
            assert!(dark.contains(&declared), "{name}");
        }
    }

    #[test]
    fn a_colour_of_a_curve_is_the_same_in_pictures_and_on_pages() {
        for (name, colour) in PICTURES {
            assert!(style().contains(&format!("--{name}: {}", hex(colour))));
            assert!(plots_script().contains(&hex(colour)));
        }
    }
}
