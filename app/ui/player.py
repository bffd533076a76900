"""A film played in the browser: frames are sent once, then played, paused and scrubbed there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import param
from bokeh.models import ColumnDataSource
from panel.custom import JSComponent

Frames = Mapping[tuple[str, str], np.ndarray]
"""Element label and column → (n_frames, n_points) values of every frame."""


class Player(JSComponent):
    """Play, pause and scrub through frames that the server computed.

    The browser writes each frame into the figures' data sources itself, so that nothing travels
    while a film plays; only where it comes to rest is told to the server (`value`). The arrays
    are changed in place and never sent back.
    """

    frames = param.Bytes(default=b"", doc="float32 values of all targets, one after the other")
    targets = param.List([], doc="[id of the data source, column, values per frame] of each target")
    captions = param.List([], doc="what is said of each frame")
    value = param.Integer(0, doc="frame shown, when it is at rest")
    label = param.String("Film", doc="name of the slider, for screen readers")
    seconds = param.Number(5.0, doc="how long the whole film takes")
    plays = param.Integer(0, doc="raised to play the film from its beginning")
    autoplay = param.Boolean(False, doc="whether it plays once by itself, where motion is not unwelcome")

    _esm = """
    export function render({model}) {
      const box = document.createElement("div")
      box.className = "sd-film"
      const button = document.createElement("button")
      button.type = "button"
      button.className = "sd-film-play"
      const slider = document.createElement("input")
      slider.type = "range"
      slider.className = "sd-film-slider"
      slider.min = 0
      slider.step = 1
      slider.setAttribute("aria-label", model.label)
      const words = document.createElement("span")
      words.className = "sd-film-caption"
      box.append(button, slider, words)

      let values = new Float32Array(0)
      let shown = model.value
      let playing = null
      let resting = null
      let played = false
      const last = () => Math.max(model.captions.length - 1, 0)

      const show = (frame) => {
        shown = Math.min(Math.max(frame, 0), last())
        let first = 0
        const touched = new Set()
        for (const [id, column, length] of model.targets) {
          const source = model.document?.get_model_by_id(id)
          const now = values.subarray(first + shown * length, first + (shown + 1) * length)
          first += model.captions.length * length
          const array = source?.data[column]
          const target = column === "image" ? array?.[0] : array
          if (target == null || target.length !== now.length || now.length !== length) { continue }
          target.set(now)
          touched.add(source)
        }
        for (const source of touched) { source.change.emit() }
        slider.value = shown
        words.textContent = model.captions[shown] ?? ""
        slider.setAttribute("aria-valuetext", words.textContent)
        box.dataset.frame = shown
      }
      const say = () => {
        const play = playing == null
        button.textContent = play ? "▶ Play" : "❚❚ Pause"
        button.setAttribute("aria-label", play ? "Play the film" : "Pause the film")
        box.dataset.playing = !play
      }
      const rest = () => {
        clearTimeout(resting)
        resting = setTimeout(() => { model.value = shown }, 150)
      }
      const stop = () => {
        if (playing != null) { cancelAnimationFrame(playing) }
        playing = null
        say()
      }
      const start = () => {
        clearTimeout(resting)
        const from = shown >= last() ? 0 : shown
        let began = null
        let told = null
        const tick = (now) => {
          began ??= now
          told ??= now
          const frame = from + Math.floor((now - began) / 1000 / model.seconds * last())
          if (frame !== shown) { show(frame) }
          // What is said of the film elsewhere follows it, too, but not at every frame.
          if (now - told > 1000) { told = now; model.value = shown }
          if (shown >= last()) { stop(); rest() } else { playing = requestAnimationFrame(tick) }
        }
        show(from)
        box.dataset.starts = Number(box.dataset.starts ?? 0) + 1
        playing = requestAnimationFrame(tick)
        say()
      }
      button.addEventListener("click", () => {
        if (playing == null) { start() } else { stop(); rest() }
      })
      slider.addEventListener("input", () => { stop(); show(Number(slider.value)); rest() })

      // The parts of a film arrive one by one: wait for the last, whichever it is.
      const whole = () => {
        const each = model.targets.reduce((sum, [id, column, length]) => sum + length, 0)
        return (model.frames?.byteLength ?? 0) === 4 * each * model.captions.length
      }
      const load = () => {
        if (!whole()) { return }
        values = model.frames?.byteLength ? new Float32Array(model.frames) : new Float32Array(0)
        slider.max = last()
        button.disabled = slider.disabled = values.length === 0
        show(playing == null ? model.value : shown)
        if (model.autoplay && !played && values.length > 0) {
          played = true
          if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) { start() }
        }
      }
      for (const part of ["targets", "captions", "frames"]) { model.on(part, load) }
      model.on("value", () => { if (playing == null && model.value !== shown) { show(model.value) } })
      model.on("plays", () => { stop(); shown = last(); start() })
      model.on("remove", () => { stop(); clearTimeout(resting) })
      say()
      load()
      return box
    }
    """
    _stylesheets = [
        """
        .sd-film { display: flex; flex-wrap: wrap; align-items: center; gap: 6px 14px;
                   font: var(--sd-type, 14px)/1.5 Roboto, sans-serif; color: inherit; }
        .sd-film-play { font: inherit; color: inherit; background: none; min-width: 96px; min-height: 36px;
                        border: 1px solid currentColor; border-radius: 4px; padding: 4px 12px;
                        cursor: pointer; }
        .sd-film-play:disabled { opacity: 0.5; cursor: default; }
        .sd-film-slider { flex: 1 1 180px; min-width: 120px; accent-color: #0072B2; height: 28px; }
        .sd-film-caption { flex: 0 1 260px; font-variant-numeric: tabular-nums; }
        .sd-film :focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]

    def load(
        self, frames: Frames, sources: Mapping[str, ColumnDataSource], captions: Sequence[str], value: int
    ) -> None:
        """Send a film to the browser; it shows frame `value`.

        Parameters
        ----------
        frames
            For each element label and column, the values of every frame.
        sources
            By element label, what the values are written to; their columns must have as many values
            as a frame has.
        """
        arrays = {key: np.ascontiguousarray(array, dtype=np.float32) for key, array in frames.items()}
        self.param.update(
            targets=[[sources[label].id, column, array[0].size] for (label, column), array in arrays.items()],
            captions=list(captions),
            value=value,
            frames=b"".join(array.tobytes() for array in arrays.values()),
        )
