// Browsers start no worker for a page that was opened from a folder: search then runs in a hidden frame.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super()
      this.waiting = []
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      document.body.appendChild(this.frame)
      const inner = this.frame.contentWindow
      const tell = data => {
        const event = new MessageEvent("message", {data})
        this.dispatchEvent(event)
        if (this.onmessage) this.onmessage(event)
      }
      inner.document.open()
      inner.document.write("<!doctype html><title>search</title><body></body>")
      inner.document.close()
      inner.postMessage = tell
      inner.importScripts = (...sources) => sources.reduce(
        (done, source) => done.then(() => load(inner, source)), Promise.resolve())
      load(inner, address).then(() => {
        this.ready = true
        this.waiting.splice(0).forEach(data => this.postMessage(data))
      })
    }
    postMessage(data) {
      if (!this.ready) return void this.waiting.push(data)
      const inner = this.frame.contentWindow
      inner.dispatchEvent(new inner.MessageEvent("message", {data}))
    }
    terminate() { this.frame.remove() }
  }
}

function load(inner, source) {
  return new Promise((done, failed) => {
    const script = inner.document.createElement("script")
    script.src = source
    script.onload = done
    script.onerror = failed
    inner.document.body.appendChild(script)
  })
}
