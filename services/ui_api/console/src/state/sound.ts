// Pulses after IEC 60601-1-8: ten for a high priority, three for a medium, one for a low.
import type { Priority } from "./alarms";

const PULSES: Readonly<Record<Priority, number>> = { high: 10, medium: 3, low: 1 };
const PITCH_HZ: Readonly<Record<Priority, number>> = { high: 880, medium: 660, low: 440 };
/** Between one burst and the next. */
export const AGAIN_AFTER_MS: Readonly<Record<Priority, number>> = {
  high: 8_000,
  medium: 15_000,
  low: 30_000,
};
const PULSE_S = 0.15;
const GAP_S = 0.15;
const VOLUME = 0.2;

/** Sound one burst. */
export function sound(audio: AudioContext, priority: Priority): void {
  for (let pulse = 0; pulse < PULSES[priority]; pulse++) {
    const from = audio.currentTime + pulse * (PULSE_S + GAP_S);
    const [tone, volume] = [audio.createOscillator(), audio.createGain()];
    tone.frequency.value = PITCH_HZ[priority];
    volume.gain.setValueAtTime(0, from);
    volume.gain.linearRampToValueAtTime(VOLUME, from + 0.02);
    volume.gain.setValueAtTime(VOLUME, from + PULSE_S - 0.02);
    volume.gain.linearRampToValueAtTime(0, from + PULSE_S);
    tone.connect(volume).connect(audio.destination);
    tone.start(from);
    tone.stop(from + PULSE_S);
  }
}
