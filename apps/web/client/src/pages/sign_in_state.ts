import { signal } from '@preact/signals';

// Why the link did not sign in.
export const signInProblem = signal('');
