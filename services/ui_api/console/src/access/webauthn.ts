// Between the JSON form of WebAuthn, as the gateway speaks it, and what browsers take and give. Older ones have no
// `toJSON` and no `parse...FromJSON`, so that this is written out.

type Json = Readonly<Record<string, unknown>>;

/** Whether this browser can ask a passkey: only on pages that were loaded by HTTPS, or from this machine by its name. */
export function hasPasskeys(): boolean {
  return typeof globalThis.PublicKeyCredential === "function" && navigator.credentials !== undefined;
}

export function bytesOf(text: string): ArrayBuffer {
  const binary = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes.buffer;
}

export function textOf(buffer: ArrayBuffer): string {
  const binary = Array.from(new Uint8Array(buffer), (byte) => String.fromCharCode(byte)).join("");
  return btoa(binary).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** Make a passkey after the gateway's options; what it answered, for the gateway. Throws `DOMException`. */
export async function madePasskey(options: Json): Promise<Json> {
  const user = options.user as Json;
  const publicKey = {
    ...options,
    challenge: bytesOf(String(options.challenge)),
    user: { ...user, id: bytesOf(String(user.id)) },
    excludeCredentials: withBytes(options.excludeCredentials),
  } as unknown as PublicKeyCredentialCreationOptions;
  const made = (await navigator.credentials.create({ publicKey })) as PublicKeyCredential;
  const answer = made.response as AuthenticatorAttestationResponse;
  return answered(made, {
    clientDataJSON: textOf(answer.clientDataJSON),
    attestationObject: textOf(answer.attestationObject),
    transports: answer.getTransports?.() ?? [],
  });
}

/** Let a passkey sign the gateway's challenge. Throws `DOMException`. */
export async function signedByPasskey(options: Json): Promise<Json> {
  const publicKey = {
    ...options,
    challenge: bytesOf(String(options.challenge)),
    allowCredentials: withBytes(options.allowCredentials),
  } as unknown as PublicKeyCredentialRequestOptions;
  const signed = (await navigator.credentials.get({ publicKey })) as PublicKeyCredential;
  const answer = signed.response as AuthenticatorAssertionResponse;
  return answered(signed, {
    clientDataJSON: textOf(answer.clientDataJSON),
    authenticatorData: textOf(answer.authenticatorData),
    signature: textOf(answer.signature),
    userHandle: answer.userHandle && textOf(answer.userHandle),
  });
}

function answered(credential: PublicKeyCredential, response: Json): Json {
  return {
    id: credential.id,
    rawId: textOf(credential.rawId),
    type: credential.type,
    response,
    clientExtensionResults: credential.getClientExtensionResults(),
  };
}

function withBytes(credentials: unknown): readonly Json[] {
  const listed = (credentials ?? []) as readonly Json[];
  return listed.map((one) => ({ ...one, id: bytesOf(String(one.id)) }));
}
