// An element for other pages: <specula-scene src="site/" view="layer=normal"></specula-scene> shows
// the page of a folder, once it is scrolled to; `view` is the fragment of its address.
class SpeculaScene extends HTMLElement {
  static observedAttributes = ["src", "view"];

  connectedCallback() {
    if (!this.style.display) this.style.display = "block";
    const frame = Object.assign(document.createElement("iframe"), { loading: "lazy", allow: "fullscreen" });
    frame.title = this.getAttribute("title") ?? "A scene that can be turned and relit";
    frame.style.cssText = "width: 100%; height: 100%; border: 0";
    const page = new URL(this.getAttribute("src") ?? "", document.baseURI);
    page.hash = this.getAttribute("view") ?? "";
    frame.src = page;
    this.replaceChildren(frame);
  }

  attributeChangedCallback() {
    if (this.isConnected) this.connectedCallback();
  }
}

customElements.define("specula-scene", SpeculaScene);
