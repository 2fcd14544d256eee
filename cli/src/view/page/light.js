// Which light the scene is under, turned and made brighter; new ones are opened, or dropped onto the page.

/** How often it is tried to send a light, and milliseconds in between. */
const ATTEMPTS = 120;
const WAIT = 1000;

export class Light {
  /** `asked` are the words of the address. */
  constructor(server, asked, changed, say) {
    Object.assign(this, { server, changed, say, id: 0, turn: 0, stops: 0 });
    const element = (id) => document.getElementById(id);
    [this.choice, this.panorama, this.file] = ["lights", "panorama", "light-file"].map(element);
    [this.turnInput, this.stopsInput] = ["turn", "stops"].map(element);
    element("light").hidden = !server.scene.shaded;
    server.scene.lights.forEach((light) => this.offer(light));
    this.choice.addEventListener("change", () => this.choose(Number(this.choice.value)));
    element("open-light").addEventListener("click", () => this.file.click());
    this.file.addEventListener("change", () => this.bring([...this.file.files]));
    this.turnInput.addEventListener("input", () => this.set({ turn: Number(this.turnInput.value) }));
    this.stopsInput.addEventListener("input", () => this.set({ stops: Number(this.stopsInput.value) }));
    this.takeDrags();
    this.takeDrops();
    this.backdrop = element("backdrop");
    this.backdrop.addEventListener("change", () => this.changed());
    if (server.scene.shaded && server.scene.lights.length > 0) this.restore(asked);
  }

  /** Takes what the address holds. */
  restore({ light, turn, stops, backdrop }) {
    const { lights } = this.server.scene;
    this.backdrop.checked = backdrop === "env";
    this.set({ turn: Number(turn) || 0, stops: Number(stops) || 0 });
    this.choose(lights.some(({ id }) => id === Number(light)) ? Number(light) : lights[0].id);
  }

  /** The words that hold it, for the address. */
  state() {
    const words = { light: this.id, turn: this.turn, stops: this.stops };
    const kept = Object.fromEntries(Object.entries(words).filter(([, word]) => word !== 0));
    return this.backdrop.checked ? { ...kept, backdrop: "env" } : kept;
  }

  toggleBackdrop() {
    this.backdrop.checked = !this.backdrop.checked;
    this.changed();
  }

  /** The words of a query. */
  words() {
    const { id: light, turn, stops } = this;
    return { light, turn, stops, ...(this.backdrop.checked ? { backdrop: "env" } : {}) };
  }

  offer({ id, name }) {
    this.choice.add(new Option(name, id));
  }

  choose(id) {
    this.id = id;
    this.choice.value = id;
    this.look();
    this.set({});
  }

  /** Shows what the light looks like now. */
  look() {
    this.server
      .get("light", { light: this.id })
      .then((response) => response.blob())
      .then((blob) => {
        URL.revokeObjectURL(this.url);
        this.url = URL.createObjectURL(blob);
        this.panorama.style.backgroundImage = `url(${this.url})`;
      })
      .catch(() => (this.panorama.style.backgroundImage = "none"));
  }

  /** Another turn in degrees, or exposure in stops. */
  set({ turn = this.turn, stops = this.stops }) {
    this.turn = ((((turn + 180) % 360) + 360) % 360) - 180;
    this.stops = Math.min(Math.max(stops, -4), 4);
    this.turnInput.value = this.turn;
    this.stopsInput.value = this.stops;
    document.getElementById("turn-told").value = `${Math.round(this.turn)}°`;
    document.getElementById("stops-told").value = this.stops > 0 ? `+${this.stops}` : this.stops;
    this.panorama.style.filter = `brightness(${2 ** (this.stops / 2.2)})`;
    this.place();
    this.changed();
  }

  /** Puts the panorama where it is turned to; what is to the left of it is counterclockwise, seen from above. */
  place() {
    this.panorama.style.backgroundPositionX = `${(-this.turn / 360) * this.panorama.clientWidth}px`;
  }

  takeDrags() {
    const { panorama } = this;
    panorama.addEventListener("pointerdown", (event) => panorama.setPointerCapture(event.pointerId));
    panorama.addEventListener("pointermove", (event) => {
      if (!panorama.hasPointerCapture(event.pointerId)) return;
      this.set({ turn: Math.round(this.turn - (360 * event.movementX) / panorama.clientWidth) });
    });
  }

  takeDrops() {
    const holdsFiles = (event) => event.dataTransfer?.types.includes("Files");
    const mark = (isOver) => document.body.classList.toggle("dropping", isOver);
    window.addEventListener("dragover", (event) => {
      if (!holdsFiles(event)) return;
      event.preventDefault();
      mark(true);
    });
    window.addEventListener("dragleave", (event) => event.relatedTarget === null && mark(false));
    window.addEventListener("drop", (event) => {
      event.preventDefault();
      mark(false);
      this.bring([...event.dataTransfer.files]);
    });
  }

  /** Sends a file when the server reads no other one, and says that it waits. */
  async send(file, words) {
    for (let attempt = 1; ; attempt++) {
      // A server that refuses so much may close the connection before its answer is read, so it is asked first.
      const { reading } = await (await this.server.get("scene", {})).json();
      try {
        if (!reading) return await this.server.post("light", words, file);
      } catch (error) {
        if (error.isFinal || attempt === ATTEMPTS) throw error;
      }
      this.say(`another light is being read; ${file.name} waits for its turn`, "note");
      await new Promise((resume) => setTimeout(resume, WAIT));
    }
  }

  /** Sends files to the server, and shows the scene under the last of them. */
  async bring(files) {
    const sentences = [];
    for (const file of files) {
      this.say(`reading ${file.name} …`, "note");
      try {
        const up = document.getElementById("y-up").checked ? "y" : "scene";
        const response = await this.send(file, { name: file.name, up });
        const light = await response.json();
        this.offer(light);
        this.choose(light.id);
        sentences.push(...light.notes);
      } catch (error) {
        sentences.push(error.message);
      }
    }
    this.say(sentences.join("; "));
    this.file.value = "";
  }
}
