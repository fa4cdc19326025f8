// Tones of alarms and questions; a browser lets a page sound only after a click in it.
let audio = null;

export const sound = {
  get on() {
    return audio !== null;
  },
  toggle() {
    if (audio) void audio.close(), (audio = null);
    else audio = new AudioContext();
  },
};

/** `times` short tones of `hertz`. */
export function tone(hertz, times = 1) {
  if (!audio) return;
  for (let i = 0; i < times; ++i) {
    const source = audio.createOscillator(), gain = audio.createGain(), at = audio.currentTime + i * 0.25;
    source.frequency.value = hertz;
    gain.gain.setValueAtTime(0.15, at);
    gain.gain.exponentialRampToValueAtTime(0.001, at + 0.2);
    source.connect(gain).connect(audio.destination);
    source.start(at);
    source.stop(at + 0.2);
  }
}
