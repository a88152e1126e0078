import { expect, it } from "vitest";
import { graphicsNamed } from "./graphics";

it.each([
  [
    "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero) (0x0000C0DE)), SwiftShader driver)",
    "processor",
  ],
  ["llvmpipe (LLVM 15.0.6, 256 bits)", "processor"],
  ["ANGLE (Microsoft, Microsoft Basic Render Driver Direct3D11)", "processor"],
  ["ANGLE (Intel, Mesa Intel(R) UHD Graphics 630, OpenGL 4.6)", "card"],
  ["Adreno (TM) 650", "card"],
])("%s is a %s", (renderer, expected) => {
  expect(graphicsNamed(renderer)).toBe(expected);
});
