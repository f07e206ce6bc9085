// Search runs in a Worker, which browsers refuse to pages from disk. There it runs in a hidden
// frame instead: a frame without an address of its own has the page's origin.
if (location.protocol === "file:") {
  window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.documentElement.append(frame);
      const inside = frame.contentWindow;
      inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", { data }));
      inside.importScripts = (...urls) =>
        urls.reduce((before, one) => before.then(() => added(frame, one)), Promise.resolve());
      this.inside = inside;
      this.ready = added(frame, url);
    }

    postMessage(data) {
      this.ready.then(() =>
        this.inside.dispatchEvent(new this.inside.MessageEvent("message", { data })));
    }

    terminate() {
      this.inside.frameElement.remove();
    }
  };

  function added(frame, url) {
    const script = frame.contentDocument.createElement("script");
    script.src = url;
    return new Promise(done => {
      script.onload = done;
      frame.contentDocument.documentElement.append(script);
    });
  }

  window.Worker = window.IFrameWorker;
}
