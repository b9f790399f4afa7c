//! Optional parts of a texture when its grid changes: parts with one value per node follow the nodes.

use model_format::{CodebookSpec, ExcitationSpec, LineSpec, LinesSpec, PartsSpec};

/// Position of a node of a new grid between two nodes of the old one, which may be the same node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Between {
    /// Indices of the two nodes in the old grid.
    pub nodes: [usize; 2],
    /// Fraction of the way from the first to the second node, 0 to 1.
    pub share: f32,
}

impl Between {
    /// Returns the position of the old grid's node `index`.
    pub fn at(index: usize) -> Self {
        Self {
            nodes: [index; 2],
            share: 0.0,
        }
    }
}

/// Returns `parts` for a new grid whose nodes, speed-major, are at these `places` of the old grid.
///
/// A node between two others gets the codebook of the nearer one. Its lines get the amplitude that the device plays
/// there, which is linear between nodes. A codebook or a line that no node uses any more is dropped.
pub(crate) fn on_grid(parts: &PartsSpec, places: &[Between]) -> PartsSpec {
    PartsSpec {
        excitation: parts
            .excitation
            .as_ref()
            .and_then(|e| excitation(e, places)),
        modulation: parts.modulation.clone(),
        lines: parts.lines.as_ref().and_then(|l| lines(l, places)),
    }
}

/// Returns an estimate of the bytes that `parts` take in a library. It is never too low.
pub fn bytes(parts: &PartsSpec) -> usize {
    /// Kind, length, and the numbers before the codes, entries or amplitudes.
    const HEADER_BYTES: usize = 16;
    let excitation = parts.excitation.iter().map(|part| {
        let codebook = |codebook: &CodebookSpec| HEADER_BYTES + codebook.codes.len();
        HEADER_BYTES + part.of_nodes.len() + part.codebooks.iter().map(codebook).sum::<usize>()
    });
    let modulation = parts.modulation.iter();
    let modulation = modulation.map(|part| HEADER_BYTES + part.entries.len());
    let lines = parts.lines.iter().map(|part| {
        let line = |line: &LineSpec| HEADER_BYTES + size_of::<f32>() * line.amplitudes.len();
        // More than enough: the part has a byte per line, and three numbers per wander.
        let wanders = (HEADER_BYTES + part.lines.len()) * (1 + part.wanders.len());
        HEADER_BYTES + wanders + part.lines.iter().map(line).sum::<usize>()
    });
    excitation.chain(modulation).chain(lines).sum()
}

fn excitation(old: &ExcitationSpec, places: &[Between]) -> Option<ExcitationSpec> {
    let nearer = |place: &Between| old.of_nodes[place.nodes[usize::from(place.share > 0.5)]];
    let sources: Vec<u8> = places.iter().map(nearer).collect();
    let mut codebooks = Vec::new();
    // Index 0 is Gaussian noise, which keeps its number.
    let mut numbers = vec![0; old.codebooks.len() + 1];
    for (index, codebook) in old.codebooks.iter().enumerate() {
        if sources
            .iter()
            .any(|&source| usize::from(source) == index + 1)
        {
            codebooks.push(codebook.clone());
            numbers[index + 1] = codebooks.len() as u8;
        }
    }
    let of_nodes = sources.iter().map(|&source| numbers[usize::from(source)]);
    (!codebooks.is_empty()).then(|| ExcitationSpec {
        of_nodes: of_nodes.collect(),
        codebooks,
        moment_samples: old.moment_samples,
    })
}

fn lines(old: &LinesSpec, places: &[Between]) -> Option<LinesSpec> {
    let moved = |line: &LineSpec| {
        let amplitude = |place: &Between| {
            let [a, b] = place.nodes.map(|node| line.amplitudes[node]);
            a + place.share * (b - a)
        };
        let amplitudes: Vec<f32> = places.iter().map(amplitude).collect();
        amplitudes.iter().any(|&a| a > 0.0).then(|| LineSpec {
            amplitudes,
            ..line.clone()
        })
    };
    let lines: Vec<LineSpec> = old.lines.iter().filter_map(moved).collect();
    (!lines.is_empty()).then(|| LinesSpec::with_wanders(lines, &old.wanders))
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::ModulationSpec;

    fn parts() -> PartsSpec {
        let codebook = |code: i8| CodebookSpec {
            peak: 4.0,
            codes: vec![code; 3],
        };
        let line = |wavelength_mm: f32, amplitudes: [f32; 3]| LineSpec {
            wavelength_mm,
            phase: 7,
            amplitudes: amplitudes.to_vec(),
            ..LineSpec::default()
        };
        PartsSpec {
            excitation: Some(ExcitationSpec {
                codebooks: vec![codebook(1), codebook(2)],
                of_nodes: vec![1, 0, 2],
                moment_samples: Some(500),
            }),
            modulation: Some(ModulationSpec {
                step_samples: 50,
                entries: vec![0; 20],
            }),
            lines: Some(LinesSpec {
                lines: vec![line(0.5, [1.0, 3.0, 0.0]), line(2.0, [4.0, 0.0, 0.0])],
                ..LinesSpec::default()
            }),
        }
    }

    #[test]
    fn the_same_nodes_keep_all_parts() {
        let same: Vec<Between> = (0..3).map(Between::at).collect();
        assert_eq!(on_grid(&parts(), &same), parts());
        assert_eq!(on_grid(&PartsSpec::default(), &same), PartsSpec::default());
    }

    #[test]
    fn a_node_between_others_has_the_nearer_codebook_and_the_mean_of_lines() {
        let between = |share| Between {
            nodes: [0, 1],
            share,
        };
        let places = [Between::at(0), between(0.25), between(0.75), Between::at(1)];
        let moved = on_grid(&parts(), &places);
        let excitation = moved.excitation.unwrap();
        assert_eq!(excitation.of_nodes, [1, 1, 0, 0]);
        assert_eq!(
            excitation.codebooks,
            parts().excitation.unwrap().codebooks[..1]
        );
        let lines = moved.lines.unwrap().lines;
        assert_eq!(lines[0].amplitudes, [1.0, 1.5, 2.5, 3.0]);
        assert_eq!(lines[1].amplitudes, [4.0, 3.0, 1.0, 0.0]);
    }

    #[test]
    fn codebooks_and_lines_that_no_node_uses_go_and_the_others_are_numbered_anew() {
        let last = on_grid(&parts(), &[Between::at(2)]);
        let excitation = last.excitation.unwrap();
        assert_eq!(excitation.of_nodes, [1]);
        assert_eq!(
            excitation.codebooks,
            parts().excitation.unwrap().codebooks[1..]
        );
        assert_eq!(last.lines, None);
        assert_eq!(last.modulation, parts().modulation);
        assert_eq!(on_grid(&parts(), &[Between::at(1)]).excitation, None);
    }
}
