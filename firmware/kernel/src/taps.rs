//! Interpolation of a predictor's taps between four nodes, in runs that all of them have.

/// Binary digits of a factor of one: a product with a code is then one of two 32-bit words, and four of them fit in 64
/// bits.
pub const FACTOR_BITS: u32 = 30;

/// Taps of the four nodes around a motion that all of them have, with as many in each slice.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Codes by node.
    pub codes: Codes<'a>,
    /// Factors of the codes of 32 bits, by node; see [`FACTOR_BITS`].
    pub factors: [i32; 4],
}

/// Codes of four nodes.
#[derive(Clone, Copy, Debug)]
pub enum Codes<'a> {
    /// Codes of 16 bits, `i16`: the upper halves of those of 32.
    Halves([&'a [[u8; 2]]; 4]),
    /// Codes of 32 bits, `i32`.
    Words([&'a [[u8; 4]]; 4]),
}

impl Run<'_> {
    /// The taps after the first `taps`, of which there are as many or more.
    #[must_use]
    pub fn after(&self, taps: usize) -> Self {
        Self {
            codes: match self.codes {
                Codes::Halves(codes) => Codes::Halves(codes.map(|codes| &codes[taps..])),
                Codes::Words(codes) => Codes::Words(codes.map(|codes| &codes[taps..])),
            },
            factors: self.factors,
        }
    }
}

/// [`crate::arithmetic::Arithmetic::mean_coefficients`] in plain Rust.
pub(crate) fn mean_coefficients(run: &Run<'_>, coefficients: &mut [i32]) {
    match run.codes {
        Codes::Halves(codes) => means(run, codes, coefficients, |&code| {
            i32::from(i16::from_le_bytes(code)) << 16
        }),
        Codes::Words(codes) => means(run, codes, coefficients, |&code| i32::from_le_bytes(code)),
    }
}

#[inline(always)]
fn means<T>(
    run: &Run<'_>,
    codes: [&[T]; 4],
    coefficients: &mut [i32],
    word: impl Fn(&T) -> i32 + Copy,
) {
    let [first, second, third, fourth] = run.factors.map(i64::from);
    let product = |code: &T, factor: i64| i64::from(word(code)) * factor;
    let [a, b, c, d] = codes;
    for ((((coefficient, a), b), c), d) in coefficients.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        let sum = product(a, first) + product(b, second) + product(c, third) + product(d, fourth);
        *coefficient = ((sum + (1 << (FACTOR_BITS - 1))) >> FACTOR_BITS) as i32;
    }
}
