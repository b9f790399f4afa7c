//! Properties of the decoder and the host's parsers, each for any bytes: no panic; what is accepted is
//! within its bounds, and comes back from what a writer makes of it; what is refused is named with its file and place.
//!
//! Memory and time are libFuzzer's to bound: see `smoke`.

mod decode;
#[cfg(feature = "parsers")]
mod parsers;
pub mod seeds;

/// A target: judges any bytes, and panics if a property does not hold.
pub type Judge = fn(&[u8]);

/// The targets by their names: the decoder, and with the feature the parsers of the host.
pub fn targets() -> Vec<(&'static str, Judge)> {
    let decoder: [(&str, Judge); 1] = [("decode", decode::judge)];
    #[cfg(feature = "parsers")]
    let decoder = decoder.into_iter().chain(parsers::TARGETS);
    decoder.into_iter().collect()
}
