//! The four nodes of the grid around a motion. Their lattices are cut into runs of stages that all four store alike.

use model_format::{Coefficients, Tail, Texture};

use crate::arithmetic::Arithmetic;
use crate::grid::GridPoint;
use crate::rotation::{Rotation, SUM_PER_THETA};
use crate::theta::{Codes, PER_CODE, PER_FRACTION, Run};

/// The four nodes around a motion.
pub(crate) struct Nodes<'a> {
    codes: [&'a [[u8; 2]]; 4],
    fractions: [&'a [u8]; 4],
    tails: [Tail<'a>; 4],
    weights: [u32; 4],
    /// Powers of the output, (m/s²)².
    pub(crate) powers: [f32; 4],
}

impl<'a> Nodes<'a> {
    /// The nodes of `texture` around `point` of its grid.
    pub(crate) fn at(texture: &Texture<'a>, point: &GridPoint) -> Self {
        let mut nodes = Self {
            codes: [&[]; 4],
            fractions: [&[]; 4],
            tails: [Tail::default(); 4],
            weights: point.weights,
            powers: [0.0; 4],
        };
        for (index, &(speed, force)) in point.nodes.iter().enumerate() {
            let node = texture.node(speed, force);
            nodes.powers[index] = node.output_power;
            let Coefficients { codes, fractions, tail } = node.coefficients;
            nodes.codes[index] = codes;
            nodes.fractions[index] = fractions;
            nodes.tails[index] = tail;
        }
        nodes
    }

    /// Writes the rotations interpolated between the nodes to `rotations`, the first stage first. Stages that a node's
    /// model lacks have θ = 0.
    pub(crate) fn interpolate<A: Arithmetic>(&self, mut rotations: &mut [Rotation]) {
        let mut done = 0;
        while !rotations.is_empty()
            && let Some((run, stages)) = self.run(done, rotations.len())
        {
            let now;
            (now, rotations) = rotations.split_at_mut(stages);
            A::mean_rotations(&run, now);
            done += stages;
        }
        rotations.fill(Rotation::NONE);
    }

    /// The run that begins at stage `done`, and its number of stages, at most `most`; none if no node has a stage left.
    ///
    /// In a texture, either every node of more than [`model_format::limits::MAX_FINE_STAGES`] stages has a tail after
    /// that many stages, or none has. So no node has codes of 16 bits in a run of tails.
    fn run(&self, done: usize, most: usize) -> Option<(Run<'a>, usize)> {
        let mut stages = most;
        let (mut coded, mut fine, mut tailed) = (None, None, None);
        for index in 0..4 {
            let codes = self.codes[index].len();
            if done < codes {
                stages = stages.min(codes - done);
                coded = Some(index);
                let fractions = self.fractions[index].len();
                if done < fractions {
                    stages = stages.min(fractions - done);
                    fine = Some(index);
                }
            } else if done - codes < self.tails[index].codes.len() {
                stages = stages.min(codes + self.tails[index].codes.len() - done);
                tailed = Some(index);
            }
        }
        if stages == 0 {
            return None;
        }
        let Some(coded) = coded else {
            return tailed.map(|other| (self.tail(done, stages, other), stages));
        };
        let codes = self.codes(done, stages, coded);
        let run = match fine {
            None => Run::Codes(codes),
            Some(other) => self.fine(done, stages, codes, other),
        };
        Some((run, stages))
    }

    /// Returns the codes of `stages` stages from `done` on, those of node `other` for a node that has none.
    fn codes(&self, done: usize, stages: usize, other: usize) -> Codes<'a> {
        let mut run = Codes {
            codes: [&self.codes[other][done..done + stages]; 4],
            factors: [0; 4],
        };
        for index in 0..4 {
            if let Some(codes) = self.codes[index].get(done..done + stages) {
                run.codes[index] = codes;
                run.factors[index] = (self.weights[index] * PER_CODE).cast_signed();
            }
        }
        run
    }

    /// Like [`Nodes::codes`], with fractions.
    fn fine(&self, done: usize, stages: usize, codes: Codes<'a>, other: usize) -> Run<'a> {
        let mut fractions = [&self.fractions[other][done..done + stages]; 4];
        let mut factors = [0; 4];
        for index in 0..4 {
            if let Some(own) = self.fractions[index].get(done..done + stages) {
                fractions[index] = own;
                factors[index] = (self.weights[index] * PER_FRACTION).cast_signed();
            }
        }
        Run::Fine {
            codes,
            fractions,
            factors,
        }
    }

    /// Like [`Nodes::codes`], for tails.
    fn tail(&self, done: usize, stages: usize, other: usize) -> Run<'a> {
        let first = |index: usize| done.saturating_sub(self.codes[index].len());
        let own = |index: usize| self.tails[index].codes.get(first(index)..first(index) + stages);
        let mut codes = [own(other).unwrap_or_default(); 4];
        let mut factors = [0; 4];
        for index in 0..4 {
            if done >= self.codes[index].len()
                && let Some(own) = own(index)
            {
                codes[index] = own;
                let step = u64::from(self.tails[index].step);
                let factor = step * u64::from(self.weights[index]) * u64::from(SUM_PER_THETA as u32);
                // The product has up to 39 digits. Eight are dropped, so that it fits in a word; the codes of a tail
                // are shifted up by eight instead.
                factors[index] = (factor >> 8) as i32;
            }
        }
        Run::Tail { codes, factors }
    }
}
