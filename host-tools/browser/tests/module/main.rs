//! The page's WebAssembly module, in an interpreter, against the kernel on this computer.
//!
//! The module is the kept one, or that which `STYLUS_BROWSER_MODULE` names.

mod faults;
mod same_bits;
mod session;

use std::path::PathBuf;
use std::sync::LazyLock;

use stylus_browser::{BLOCK_NUMBERS, BlockMotion};
use wasmi::{Engine, Instance, Linker, Memory, Module, Store, WasmParams};

static MODULE: LazyLock<(Engine, Module)> = LazyLock::new(|| {
    let kept = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../report/src/rub_page/kernel.wasm");
    let path = std::env::var_os("STYLUS_BROWSER_MODULE").map_or(kept, PathBuf::from);
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let engine = Engine::default();
    let module = Module::new(&engine, &bytes[..]).expect("it is a valid module");
    (engine, module)
});

/// An instance of the module with a library, and its calls by name.
struct Wasm {
    store: Store<()>,
    instance: Instance,
    memory: Memory,
}

impl Wasm {
    /// An instance without a library.
    fn empty() -> Self {
        let (engine, module) = &*MODULE;
        let mut store = Store::new(engine, ());
        let linker = <Linker<()>>::new(engine);
        let instance = linker
            .instantiate_and_start(&mut store, module)
            .expect("the module imports nothing");
        let memory = instance.get_memory(&store, "memory");
        let memory = memory.expect("the memory is exported");
        Self {
            store,
            instance,
            memory,
        }
    }

    /// An instance that has loaded `library`.
    fn with(library: &[u8]) -> Self {
        let mut wasm = Self::empty();
        assert_eq!(wasm.load(library), 0, "{}", wasm.text());
        wasm
    }

    /// Loads `library`; the status.
    fn load(&mut self, library: &[u8]) -> u32 {
        let at = self.call("reserve", library.len() as u32);
        assert_ne!(at, 0, "{}", self.text());
        self.memory
            .write(&mut self.store, at as usize, library)
            .expect("there is room");
        self.call("load", ())
    }

    fn call(&mut self, name: &str, arguments: impl WasmParams) -> u32 {
        self.try_call(name, arguments).expect("it does not trap")
    }

    fn try_call(&mut self, name: &str, arguments: impl WasmParams) -> Result<u32, wasmi::Error> {
        Ok(self
            .instance
            .get_typed_func::<_, i32>(&self.store, name)
            .unwrap_or_else(|error| panic!("{name}: {error}"))
            .call(&mut self.store, arguments)?
            .cast_unsigned())
    }

    fn text(&mut self) -> String {
        let (at, length) = (self.call("text", ()), self.call("text_length", ()));
        let bytes = self.bytes(at, length as usize);
        String::from_utf8(bytes).expect("texts are UTF-8")
    }

    fn memory_bytes(&self) -> usize {
        self.memory.data(&self.store).len()
    }

    fn bytes(&self, at: u32, length: usize) -> Vec<u8> {
        self.memory.data(&self.store)[at as usize..][..length].to_vec()
    }

    /// The first `count` values of `N` bytes of the array that the call `name` gives the address of.
    fn values<const N: usize, T>(&mut self, name: &str, count: usize, of: fn([u8; N]) -> T) -> Vec<T> {
        let at = self.call(name, ());
        let bytes = self.bytes(at, N * count);
        bytes.as_chunks().0.iter().map(|bytes| of(*bytes)).collect()
    }

    fn doubles(&mut self, name: &str, count: usize) -> Vec<f64> {
        self.values(name, count, f64::from_le_bytes)
    }

    fn set_motion(&mut self, motions: &[BlockMotion]) {
        let at = self.call("motion", ()) as usize;
        let bytes: Vec<u8> = motions
            .iter()
            .flat_map(|motion| motion.numbers())
            .flat_map(f64::to_le_bytes)
            .collect();
        assert_eq!(bytes.len(), 8 * BLOCK_NUMBERS * motions.len());
        self.memory.write(&mut self.store, at, &bytes).expect("there is room");
    }

    /// Plays `motions`; the words.
    fn run(&mut self, motions: &[BlockMotion]) -> Result<Vec<i32>, String> {
        self.set_motion(motions);
        if self.call("run", motions.len() as u32) != 0 {
            return Err(self.text());
        }
        Ok(self.words(motions.len()))
    }

    fn words(&mut self, blocks: usize) -> Vec<i32> {
        let count = blocks * self.call("block_samples", ()) as usize;
        self.values("words", count, i32::from_le_bytes)
    }

    fn samples(&mut self, blocks: usize) -> Vec<f32> {
        let count = blocks * self.call("block_samples", ()) as usize;
        self.values("samples", count, f32::from_le_bytes)
    }
}
