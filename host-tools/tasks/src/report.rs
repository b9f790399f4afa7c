//! The reader of the image's output: the lines of [`kernel_vectors::report`].

use kernel_vectors::report as keyword;

use crate::error::{Error, Result};

/// Words and measurements that the image gives on an emulated processor.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct EmulatorReport {
    /// The played textures and edges, in order.
    pub played: Vec<Played>,
    /// The costs of samples.
    pub samples: Vec<Cost>,
    /// The costs of updates of the coefficients.
    pub follows: Vec<Cost>,
}

/// A played texture, or the edges of arithmetic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Played {
    /// The multiplication of pairs of 16-bit numbers: a keyword.
    pub arithmetic: String,
    /// The texture's name; none for the edges.
    pub texture: Option<String>,
    /// The samples, in two's complement.
    pub words: Vec<u32>,
    /// The number of samples at full scale; none for the edges.
    pub full_scale: Option<u32>,
}

/// The cost of calls, in instructions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cost {
    /// The texture's name.
    pub texture: String,
    /// The cheapest call's instructions.
    pub fewest: u32,
    /// The dearest call's instructions.
    pub most: u32,
    /// The number of counted calls.
    pub calls: u32,
}

impl EmulatorReport {
    /// Reads a whole report.
    ///
    /// # Errors
    /// A line is none of a report's, or the last line is missing.
    pub fn parse(text: &str) -> Result<Self> {
        let mut report = Self::default();
        let mut ended = false;
        let mut count = 0;
        for (index, line) in text.lines().enumerate() {
            let line = line.trim_end();
            count = index + 1;
            let problem = if ended {
                Some("nothing is due after the end".to_owned())
            } else if line == keyword::END {
                ended = true;
                None
            } else {
                report.take(line).err()
            };
            if let Some(problem) = problem {
                return Err(Error::Report {
                    line: index + 1,
                    problem,
                });
            }
        }
        if ended {
            Ok(report)
        } else {
            Err(Error::Report {
                line: count + 1,
                problem: "the report ends before its last line".to_owned(),
            })
        }
    }

    fn take(&mut self, line: &str) -> std::result::Result<(), String> {
        let (first, rest) = line.split_once(' ').unwrap_or((line, ""));
        match first {
            keyword::VECTOR => {
                let (arithmetic, texture) =
                    rest.split_once(' ').ok_or("a vector without a texture")?;
                self.begin(arithmetic, Some(texture));
            }
            keyword::EDGES => self.begin(rest, None),
            keyword::WORDS => {
                let played = self.played.last_mut().ok_or("words of nothing")?;
                for word in rest.split(' ') {
                    let word = u32::from_str_radix(word, 16)
                        .map_err(|_| format!("'{word}' is no hexadecimal word"))?;
                    played.words.push(word);
                }
            }
            keyword::FULL_SCALE => {
                let played = self.played.last_mut().ok_or("a count of nothing")?;
                played.full_scale = Some(number(rest)?);
            }
            keyword::SAMPLE_COST => self.samples.push(cost(rest)?),
            keyword::FOLLOW_COST => self.follows.push(cost(rest)?),
            _ => return Err(format!("'{line}' is no line of a report")),
        }
        Ok(())
    }

    fn begin(&mut self, arithmetic: &str, texture: Option<&str>) {
        self.played.push(Played {
            arithmetic: arithmetic.to_owned(),
            texture: texture.map(str::to_owned),
            words: Vec::new(),
            full_scale: None,
        });
    }
}

fn number(text: &str) -> std::result::Result<u32, String> {
    text.parse().map_err(|_| format!("'{text}' is no number"))
}

fn cost(text: &str) -> std::result::Result<Cost, String> {
    let mut parts = text.splitn(4, ' ');
    let mut next = || {
        parts
            .next()
            .ok_or("a cost takes three numbers and a texture")
    };
    Ok(Cost {
        fewest: number(next()?)?,
        most: number(next()?)?,
        calls: number(next()?)?,
        texture: next()?.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "vector cortex-m lattice, one node\n\
                        words 0000002a ffffffff\n\
                        words 80000000\n\
                        full-scale 3\n\
                        edges portable\n\
                        words 00000001\n\
                        sample-cost 10 11 12 lattice, one node\n\
                        follow-cost 20 30 40 lattice, one node\n\
                        end\n";

    #[test]
    fn a_report_is_read_as_it_was_printed() {
        let report = EmulatorReport::parse(TEXT).expect("the text is a report");
        let [vector, edges] = &report.played[..] else {
            panic!("two were played: {report:?}");
        };
        assert_eq!(vector.arithmetic, "cortex-m");
        assert_eq!(vector.texture.as_deref(), Some("lattice, one node"));
        assert_eq!(vector.words, [0x2a, u32::MAX, 1 << 31]);
        assert_eq!(vector.full_scale, Some(3));
        assert_eq!((edges.texture.as_ref(), &edges.words[..]), (None, &[1][..]));
        let cost = |fewest, most, calls| Cost {
            texture: "lattice, one node".to_owned(),
            fewest,
            most,
            calls,
        };
        assert_eq!(report.samples, [cost(10, 11, 12)]);
        assert_eq!(report.follows, [cost(20, 30, 40)]);
    }

    #[test]
    fn a_report_cut_off_anywhere_is_refused() {
        let whole = TEXT.trim_end();
        for (end, _) in whole.char_indices() {
            assert!(
                EmulatorReport::parse(&whole[..end]).is_err(),
                "cut at {end}"
            );
        }
    }

    #[test]
    fn a_line_of_something_else_is_refused_with_its_number() {
        for wrong in [
            "panicked at main.rs",
            "words 00xx",
            "sample-cost 1 2 texture",
            "vector x",
            "end",
        ] {
            let text = TEXT.replacen("full-scale 3", wrong, 1);
            let error = EmulatorReport::parse(&text).expect_err(wrong).to_string();
            let line = if wrong == "end" { 5 } else { 4 };
            assert!(
                error.starts_with(&format!("line {line} ")),
                "{wrong}: {error}"
            );
        }
    }
}
