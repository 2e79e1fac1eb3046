// Who is signed in, and how to be rid of them.
import { useState } from 'preact/hooks';
import { api, type SignIn } from '../../api';
import { timeText } from '../../format';
import { useEvery, useLoad } from '../../hooks';
import { Button, CommandLine, Confirm, Timestamp, Notice, Table } from '../../ui';
import { attempt, toast } from '../../ui/toast';

type Asked = { kind: 'one'; row: SignIn } | { kind: 'others' } | { kind: 'token' };

const TEXTS = {
  one: {
    title: 'Sign this browser out?',
    text: 'It loses access to the studio, also in open pages. It can sign in again with a new link.',
    yes: 'Sign it out',
  },
  others: {
    title: 'Sign all others out?',
    text: 'Only this browser stays signed in. Printed links that were not opened become invalid.',
    yes: 'Sign them out',
  },
  token: {
    title: 'Make a new token?',
    text: 'Programs that use the old token are refused from now on.',
    yes: 'Make a new token',
  },
};

export function SignIns() {
  const loaded = useLoad(api.signIns);
  useEvery(15, loaded.again);
  const [asked, setAsked] = useState<Asked | null>(null);
  const [token, setToken] = useState('');
  const rows = loaded.value?.sign_ins ?? [];
  const others = rows.filter((row) => !row.own).length;
  const go = async (what: Asked) => {
    setAsked(null);
    await attempt(async () => {
      if (what.kind === 'one') {
        await api.revokeSignIn(what.row.id);
        if (what.row.own)
          await api.session(); // shows the page for signing in
        else toast('The browser was signed out.');
      } else if (what.kind === 'others') {
        const { revoked } = await api.revokeOtherSignIns();
        toast(revoked === 1 ? 'One browser was signed out.' : `${revoked} browsers were signed out.`);
      } else {
        setToken((await api.renewApiToken()).token);
      }
      loaded.again();
    });
  };
  const text = TEXTS[asked?.kind ?? 'one'];
  return (
    <div class="stack">
      {loaded.error && <Notice kind="problem">{loaded.error}</Notice>}
      <Table
        caption="Signed-in browsers, last used first"
        columns={[
          {
            name: 'Browser',
            show: (row: SignIn) => (
              <span title={row.agent}>
                {row.browser || 'unknown'} {row.own && <span class="chip chip-good">this one</span>}
              </span>
            ),
          },
          { name: 'Signed in', show: (row) => <Timestamp at={row.began} /> },
          { name: 'Address', show: (row) => row.address || 'unknown' },
          {
            name: 'Last used',
            show: (row) => (
              <>
                <Timestamp at={row.used} />
                {row.used_from !== '' && row.used_from !== row.address ? `, from ${row.used_from}` : ''}
              </>
            ),
          },
          { name: 'Expires', show: (row) => <Timestamp at={row.ends} /> },
          {
            name: 'Sign out',
            show: (row) => (
              <Button
                small
                kind="danger"
                aria-label={`Sign out ${row.own ? 'this browser' : `${row.browser || 'the browser'} from ${row.address || 'unknown'}`}`}
                onClick={() => setAsked({ kind: 'one', row })}
              >
                Sign out
              </Button>
            ),
          },
        ]}
        rows={rows}
        keyOf={(row) => row.id}
        empty={loaded.loading ? 'Loading' : 'No sign-ins.'}
      />
      <div class="row">
        <Button disabled={others === 0} onClick={() => setAsked({ kind: 'others' })}>
          Sign all others out{others > 0 ? ` (${others})` : ''}
        </Button>
      </div>
      <section class="card stack" aria-labelledby="api-token">
        <h2 id="api-token">Token for programs</h2>
        <p>
          Programs use the token in <code>.studio/api-token</code> of the workspace
          {loaded.value ? `, made ${timeText(loaded.value.api_token.made)}` : ''}. The page{' '}
          <a href="/api">API</a> shows how.
        </p>
        {token !== '' && (
          <Notice kind="good">
            <p>The new token. It is shown only once here and stored in that file:</p>
            <CommandLine text={token} label="Token" />
          </Notice>
        )}
        <div class="row">
          <Button onClick={() => setAsked({ kind: 'token' })}>Make a new token</Button>
        </div>
      </section>
      <p class="field-help">The audit log records each sign-in, each sign-out and each new token.</p>
      <Confirm
        title={text.title}
        text={text.text}
        yes={text.yes}
        open={asked !== null}
        onClose={() => setAsked(null)}
        onYes={() => {
          if (asked) void go(asked);
        }}
      />
    </div>
  );
}
