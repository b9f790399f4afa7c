//! The exports of the module: a request goes in, an answer comes out, and progress is told meanwhile.

use std::cell::RefCell;
use std::path::Path;

use stylus_support::files::{self, Bytes};
use stylus_support::progress;

use crate::ask::{Asked, answer};

/// What one call leaves for the next.
#[derive(Default)]
struct Room {
    /// A request: its text, then its bytes.
    asked: Vec<u8>,
    text: String,
    bytes: Bytes,
}

thread_local! {
    static ROOM: RefCell<Room> = RefCell::new(Room::default());
}

#[link(wasm_import_module = "page")]
// SAFETY: the page's function reads the bytes, and keeps nothing.
#[expect(unsafe_code, reason = "an import is declared by hand")]
unsafe extern "C" {
    /// Is told progress: an action as text, the steps that are done, and their number.
    safe fn progress(text: *const u8, length: usize, done: f64, total: f64);
}

fn say(text: &str) {
    ROOM.with_borrow_mut(|room| text.clone_into(&mut room.text));
}

/// Exports functions by their own names.
macro_rules! exports {
    ($($(#[doc = $doc:literal])+ fn $name:ident($($argument:ident: $kind:ty),*) $(-> $result:ty)? $body:block)+) => {
        $(
            $(#[doc = $doc])+
            // SAFETY: no other function of the module has this name, because nothing else here keeps its own and the
            // names are none of the compiler's.
            #[expect(unsafe_code, reason = "an export has to keep its name")]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name($($argument: $kind),*) $(-> $result)? $body
        )+
    };
}

exports! {
    /// Begins: all files are in memory, and a fault is told by `text`.
    fn begin() {
        files::mount(Path::new(""));
        std::panic::set_hook(Box::new(|fault| say(&fault.to_string())));
        progress::listen(|action, done, total| progress(action.as_ptr(), action.len(), done as f64, total as f64));
    }

    /// Makes room for a request of `bytes` bytes, and returns its address; 0 if there is none.
    fn reserve(bytes: usize) -> *mut u8 {
        ROOM.with_borrow_mut(|room| {
            let mut asked = Vec::new();
            // A failed allocation would end the module instead of the call.
            if asked.try_reserve_exact(bytes).is_err() {
                return std::ptr::null_mut();
            }
            asked.resize(bytes, 0);
            room.asked = asked;
            room.asked.as_mut_ptr()
        })
    }

    /// Answers the request in the room, whose text has `length` bytes. Returns 0, or 1 for a refusal; `text` has the
    /// answer as JSON, or the reason.
    fn ask(length: usize) -> u32 {
        let mut asked = ROOM.with_borrow_mut(|room| {
            // Memory that runs out ends the module without a word, and the last answer must not be taken for one.
            room.text.clear();
            std::mem::take(&mut room.asked)
        });
        let bytes = asked.split_off(length.min(asked.len()));
        let asked = serde_json::from_slice::<Asked>(&asked).map_err(|fault| fault.to_string());
        let answered = asked.and_then(|asked| answer(&asked, bytes).map_err(|fault| fault.to_string()));
        let (status, text, bytes) = match answered {
            Ok(answer) => (0, answer.told.to_string(), answer.bytes),
            Err(fault) => (1, fault, Bytes::default()),
        };
        ROOM.with_borrow_mut(|room| (room.text, room.bytes) = (text, bytes));
        status
    }

    /// Address of the last text.
    fn text() -> *const u8 {
        ROOM.with_borrow(|room| room.text.as_ptr())
    }

    /// Length of the last text, bytes.
    fn text_length() -> usize {
        ROOM.with_borrow(|room| room.text.len())
    }

    /// Address of the last answer's bytes.
    fn bytes() -> *const u8 {
        ROOM.with_borrow(|room| room.bytes.as_ptr())
    }

    /// Number of these bytes.
    fn bytes_length() -> usize {
        ROOM.with_borrow(|room| room.bytes.len())
    }
}
