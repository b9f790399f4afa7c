//! What the users of the list and of its player rely on.

mod fixtures;
mod player;
