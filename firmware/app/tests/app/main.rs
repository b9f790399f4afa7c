//! What the stylus does, tested on the host through its public interface, on flash that can lose power.
#![expect(
    clippy::result_large_err,
    reason = "an error that tells a person its reason carries the words"
)]

mod inputs;
mod player;
mod power_cut;
mod recorder;
mod requests;
mod safety;
mod settings;
mod slots;
mod upload;
