// Colours of a model with physical materials: view-dependent ones, or the materials.

export class Materials {
  /**
   * `initial` has the parameters of the URL fragment at page load, `suits` returns the default
   * colours for the light, and `isFixed` whether only those are valid.
   */
  constructor(scene, initial, suits, isFixed, changed) {
    Object.assign(this, { suits, isFixed, choice: null });
    const section = document.getElementById("colors");
    section.hidden = !scene.physical;
    this.chips = [...section.querySelectorAll("[data-shading]")];
    for (const chip of this.chips) {
      chip.addEventListener("click", () => {
        const { shading } = chip.dataset;
        this.choice = shading === suits() ? null : shading;
        this.show();
        changed();
      });
    }
    if (scene.physical && ["view", "physical"].includes(initial.shading)) this.choice = initial.shading;
    this.show();
  }

  /** Choice that differs from what suits the light; none where lamps leave none. */
  get chosen() {
    return this.isFixed() || this.choice === this.suits() ? null : this.choice;
  }

  /** Parameters of requests and of the URL fragment. */
  query() {
    return this.chosen === null ? {} : { shading: this.chosen };
  }

  /** Marks the colours that are shown. */
  show() {
    const shown = this.chosen ?? this.suits();
    for (const chip of this.chips) {
      chip.setAttribute("aria-checked", chip.dataset.shading === shown);
      chip.disabled = this.isFixed() && chip.dataset.shading !== shown;
    }
  }
}
