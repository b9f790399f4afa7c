//! Properties of the decoder and the host's parsers, which hold for any bytes. Nothing panics. Accepted input is within
//! its bounds, and where there is a writer, it is read the same after it was written again. Refused input is reported
//! with its file and place.
//!
//! libFuzzer bounds memory and time: see `smoke`.

mod decode;
#[cfg(feature = "parsers")]
mod parsers;
pub mod seeds;

/// A target: it checks any bytes, and panics if a property does not hold.
pub type Judge = fn(&[u8]);

/// The targets by their names: the decoder, and with the feature `parsers` also the parsers of the host.
pub fn targets() -> Vec<(&'static str, Judge)> {
    let decoder: [(&str, Judge); 1] = [("decode", decode::judge)];
    #[cfg(feature = "parsers")]
    let decoder = decoder.into_iter().chain(parsers::TARGETS);
    decoder.into_iter().collect()
}
