// Where the sound is computed: in the browser's audio thread. To a page that came by plain http a browser gives none;
// then the same script runs on the page's own thread.

// Samples per call on the page's thread: more time than a picture takes.
const CALL_SAMPLES = 2048;

// Begins the sound in `context`, with its own kernels. The node has the processor's port.
async function soundOf(context, kernel, library) {
  const script = byId("worklet").textContent;
  const options = { numberOfInputs: 0, outputChannelCount: [1], processorOptions: { kernel, library } };
  let node;
  if (context.audioWorklet) {
    // A blob of a page that was opened as a file is refused while the browser is offline; data is not.
    const bytes = new TextEncoder().encode(script);
    await context.audioWorklet.addModule(`data:text/javascript;base64,${base64Of(bytes)}`);
    node = new AudioWorkletNode(context, "rubbing", options);
  } else if (context.createScriptProcessor) {
    node = onThisThread(context, script, options);
  } else {
    throw new Error("this browser plays none on a page that came by http; open it as a file, or by https");
  }
  node.connect(context.destination);
  return node;
}

// A node whose samples the worklet's script computes here.
function onThisThread(context, script, options) {
  const node = context.createScriptProcessor(CALL_SAMPLES, 1, 1);
  const channel = new MessageChannel();
  node.port = channel.port1;
  let processor;
  // What the script finds in a worklet.
  Object.assign(globalThis, {
    sampleRate: context.sampleRate,
    currentFrame: 0,
    AudioWorkletProcessor: class {
      port = channel.port2;
    },
    registerProcessor: (_name, kind) => {
      processor = new kind(options);
    },
  });
  const element = document.createElement("script");
  // In a scope of its own, because it has names that the page has too.
  element.textContent = `(() => {${script}\n})();`;
  document.head.append(element);
  node.onaudioprocess = ({ outputBuffer }) => {
    const output = outputBuffer.getChannelData(0);
    processor.process([], [[output]]);
    globalThis.currentFrame += output.length;
  };
  return node;
}
