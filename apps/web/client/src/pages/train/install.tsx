// A trained model in place of the one that ships, and back.
import { useState } from 'preact/hooks';
import { api, type Json } from '../../api';
import { useLoad } from '../../hooks';
import { AsyncButton, Confirm, Notice } from '../../ui';
import { attempt, toast } from '../../ui/toast';
import { lineWith } from '../shared/jobs';

export interface InstalledModel {
  name: string;
  type: string;
  own: boolean;
  sha256: string | null;
  used_by: string;
  terms: string;
}

// All models as verbs take them now; `models list`.
export async function installedModels(): Promise<InstalledModel[]> {
  const answer = await api.run('models list');
  return answer.lines.filter(
    (line): line is { [name: string]: Json } => line !== null && typeof line === 'object' && 'name' in line,
  ) as unknown as InstalledModel[];
}

// `model`: the reference of a file; `place`: the model that ships and whose place it takes. `verdict`: how they
// compare, in words; '' where nobody compared them.
export function InstallModel(props: { model: string; place: string; comparison: string }) {
  const models = useLoad(installedModels, [props.place]);
  const [asked, setAsked] = useState(false);
  const [done, setDone] = useState<{ sha256: string; used_by: string } | null>(null);
  const now = (models.value ?? []).find((one) => one.name === props.place);
  const install = async () => {
    setAsked(false);
    await attempt(async () => {
      const answer = await api.run('models install', [props.model], { '--as': props.place });
      const line = lineWith<{ sha256: string; used_by: string }>(answer.lines, 'sha256');
      if (answer.exit !== 0 || !line) throw new Error(answer.error || 'The model was not installed.');
      setDone(line);
      models.again();
    });
  };
  const remove = async () => {
    await attempt(async () => {
      const answer = await api.run('models remove', [props.place]);
      if (answer.exit > 1) throw new Error(answer.error);
      setDone(null);
      models.again();
      toast(`${props.place}: the shipped model is used again.`);
    });
  };
  return (
    <section class="card stack" aria-labelledby="install" data-own={now ? String(now.own) : ''}>
      <h3 id="install">Install as {props.place}</h3>
      {models.error && <Notice kind="problem">{models.error}</Notice>}
      {props.comparison && <p>{props.comparison}</p>}
      {done ? (
        <Notice kind="good">
          <p>
            Installed as {props.place}. It is used by everything that starts from now on: {done.used_by}.
            Running sessions keep their model.
          </p>
          <p class="wrap">SHA-256 {done.sha256}</p>
        </Notice>
      ) : (
        <p>
          {now?.own
            ? `Another model of your own is installed as ${props.place}. This model would replace it.`
            : `The shipped model is used now.`}
          {now?.used_by ? ` Used by: ${now.used_by}.` : ''}
        </p>
      )}
      <div class="row">
        {!done && (
          <AsyncButton kind="main" run={async () => setAsked(true)}>
            Install
          </AsyncButton>
        )}
        {now?.own && <AsyncButton run={remove}>Restore the shipped model</AsyncButton>}
      </div>
      <p class="field-help">
        The file is checked before it is installed. It is stored in the workspace. The shipped model is not
        changed.
      </p>
      <Confirm
        title={`Install as ${props.place}?`}
        text={`${props.comparison ? props.comparison + ' ' : 'The two models have not been compared on the same data. '}All sessions, runs and jobs that start from now on use it.`}
        yes="Install it"
        open={asked}
        onClose={() => setAsked(false)}
        onYes={() => void install()}
      />
    </section>
  );
}
