// The sound's own thread while a take is recorded: hands every block to the page as it is.
registerProcessor("taker", class extends AudioWorkletProcessor {
  process([[channel]]) {
    if (channel) this.port.postMessage(channel.slice());
    return true;
  }
});
