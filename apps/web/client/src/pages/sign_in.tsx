import { useState } from 'preact/hooks';
import { api, errorText } from '../api';
import { useSignalValue } from '../hooks';
import { AsyncButton, CommandLine, Eyes, Notice, TextField } from '../ui/controls';
import { signInProblem } from './sign_in_state';

// The token of a whole link, or what was typed.
export function tokenOf(text: string): string {
  const word = text.trim();
  const at = word.indexOf('#t=');
  return at < 0 ? word : decodeURIComponent(word.slice(at + 3));
}

export function SignIn() {
  const problem = useSignalValue(signInProblem);
  const [text, setText] = useState('');
  return (
    <main class="sign-in" id="main" data-page="sign-in" data-ready="yes">
      <div class="card sign-in-card">
        <Eyes />
        <h1 tabIndex={-1}>Tarsier studio</h1>
        <p>
          Open the link that <code>tarsier serve</code> printed. It signs this browser in and works once.
        </p>
        {problem && <Notice kind="problem">{problem}</Notice>}
        <p>No link? Run this command on the machine that runs the studio to print a new one:</p>
        <CommandLine text="tarsier serve --link" />
        <form onSubmit={(event) => event.preventDefault()}>
          <TextField
            label="Link or token"
            help="Paste the whole link, or the part after #t="
            value={text}
            onInput={setText}
            autocomplete="off"
          />
          <AsyncButton
            kind="main"
            type="submit"
            disabled={text.trim() === ''}
            run={async () => {
              try {
                await api.signIn(tokenOf(text));
              } catch (wrong) {
                signInProblem.value = errorText(wrong);
              }
            }}
          >
            Sign in
          </AsyncButton>
        </form>
      </div>
    </main>
  );
}
