// Adding a person, step by step: what was agreed, images, what became of each.
import { useEffect, useRef, useState } from 'preact/hooks';
import { api } from '../../api';
import { AsyncButton, Button, Checkbox, FileDrop, Notice, Progress, Table, TextField } from '../../ui';
import { attempt } from '../../ui/toast';
import { setName, uploadAll } from '../shared/files';
import { drawnNames, drawnPeople } from './drawn';
import { nameProblem, enrolResultOf, type Person, type EnrolResult } from './model';

type Step = 'who' | 'images' | 'done';

// What the images of a person are: uploaded ones in a set, or files of a job.
interface Source {
  set: string | null;
  references: { name: string; reference: string }[];
}

export function Enrol(props: { people: Person[]; onEnrolled: () => void; onNext: () => void }) {
  const [step, setStep] = useState<Step>('who');
  const [name, setName_] = useState('');
  const [note, setNote] = useState('');
  const [agreed, setAgreed] = useState(false);
  const [anyQuality, setAnyQuality] = useState(false);
  const [tidy, setTidy] = useState(true);
  const [source, setSource] = useState<Source | null>(null);
  const [uploading, setUploading] = useState<{ done: number; total: number } | null>(null);
  const [shots, setShots] = useState<EnrolResult[]>([]);
  const [working, setWorking] = useState<{ done: number; total: number } | null>(null);
  const [drawing, setDrawing] = useState(false);
  const head = useRef<HTMLHeadingElement>(null);
  useEffect(() => head.current?.focus(), [step]);

  const problem = nameProblem(name);
  const ready = name.trim() !== '' && problem === '' && agreed && note.trim() !== '';
  const known = props.people.find((one) => one.name === name.trim());

  const take = async (files: { name: string; body: Blob }[]) => {
    await attempt(async () => {
      const set = source?.set ?? setName('person');
      if (source?.set === undefined || source.set === null) await api.addSet(set);
      const present = source?.set ? source.references.map((one) => one.name) : [];
      const state = await uploadAll(set, files, setUploading, present);
      setUploading(null);
      const now = await api.setFiles(set);
      setSource({
        set,
        references: now.map((one) => ({ name: one.name, reference: `set:${set}/${one.name}` })),
      });
      if (state.refused.length > 0) {
        throw new Error(state.refused.map((one) => `${one.name}: ${one.reason}`).join(' '));
      }
    });
    setUploading(null);
  };

  const enrol = async () => {
    if (!source) return;
    const results: EnrolResult[] = [];
    setWorking({ done: 0, total: source.references.length });
    // One image at a time, so that each has its own answer.
    for (const one of source.references) {
      const answer = await attempt(() =>
        api.run('people enroll', [name.trim(), one.reference], {
          '--note': note.trim(),
          '--largest': true,
          ...(anyQuality ? { '--any-quality': true } : {}),
        }),
      );
      results.push(
        enrolResultOf(
          one.name,
          answer?.lines[answer.lines.length - 1],
          answer?.error ?? 'the server did not respond',
        ),
      );
      setShots([...results]);
      setWorking({ done: results.length, total: source.references.length });
    }
    setWorking(null);
    if (tidy && source.set !== null) {
      await attempt(() => api.removeSet(source.set!));
    }
    props.onEnrolled();
    setStep('done');
  };

  const drawn = async (person: 0 | 1) => {
    setDrawing(true);
    await attempt(async () => {
      const two = await drawnPeople();
      setName_(drawnNames[person]);
      setNote('A synthetic head, not a real person.');
      setAgreed(true);
      setSource({
        set: null,
        references: two.shots[person].map((file) => ({
          name: file.split('/').pop() ?? file,
          reference: `job:${two.job}/${file}`,
        })),
      });
      setStep('images');
    });
    setDrawing(false);
  };

  const again = () => {
    setName_('');
    setNote('');
    setAgreed(false);
    setSource(null);
    setShots([]);
    setStep('who');
  };

  const acceptedCount = shots.filter((one) => one.accepted).length;
  return (
    <div class="stack wizard">
      <ol class="steps" aria-label="Steps">
        {(['who', 'images', 'done'] as Step[]).map((one, i) => (
          <li key={one} aria-current={one === step ? 'step' : undefined}>
            {i + 1}. {['Person and consent', 'Images', 'Done'][i]}
          </li>
        ))}
      </ol>
      {step === 'who' && (
        <section class="card stack" aria-labelledby="step-who">
          <h2 id="step-who" tabIndex={-1} ref={head}>
            Person and consent
          </h2>
          <Notice>
            <p>
              A face template is biometric data. Ask the person first, explain the purpose and how long the
              data is stored, and record the consent. You can show people the data that you store about them,
              and delete it at any time.
            </p>
            <p>
              Do not use it for access control: a printed image of the person is accepted, and errors occur.
            </p>
          </Notice>
          <TextField label="Name" value={name} onInput={setName_} problem={problem} required />
          {known && (
            <p class="field-help">
              {known.name} is enrolled with {known.faces} faces; new faces are added to them.
            </p>
          )}
          <TextField
            label="Consent"
            value={note}
            onInput={setNote}
            placeholder="consent of 1 May: door camera, until 31 December"
            required
          />
          <Checkbox label="This person has given consent" checked={agreed} onChange={setAgreed} />
          <div class="row row-end">
            <Button kind="main" disabled={!ready} onClick={() => setStep('images')}>
              Next: images
            </Button>
          </div>
          <hr />
          <h3>Nobody available?</h3>
          <p class="field-help">Use two synthetic people:</p>
          <div class="row">
            {drawnNames.map((one, i) => (
              <Button key={one} busy={drawing} onClick={() => void drawn(i as 0 | 1)}>
                Try with {one}
              </Button>
            ))}
          </div>
        </section>
      )}
      {step === 'images' && (
        <section class="card stack" aria-labelledby="step-images">
          <h2 id="step-images" tabIndex={-1} ref={head}>
            Images of {name.trim()}
          </h2>
          <p>
            Use five to ten images: from the front, turned slightly to each side, up and down, in the lighting
            of later use.
          </p>
          <FileDrop
            label="Images"
            help="JPEG or PNG. A phone can also open its camera here."
            accept="image/*"
            multiple
            disabled={uploading !== null || working !== null}
            onFiles={(files) => void take(files.map((file) => ({ name: file.name, body: file })))}
          />
          <Camera onShot={(body, n) => void take([{ name: `shot-${n}.jpg`, body }])} />
          {uploading && (
            <Progress label="Uploading" done={uploading.done} total={uploading.total} unit="images" />
          )}
          {source && source.references.length > 0 && (
            <ul class="thumbs" aria-label="Images to enrol">
              {source.references.map((one, i) => (
                <li key={one.reference}>
                  <img src={thumb(one.reference)} alt="" width={120} height={90} loading="lazy" />
                  <span>{one.name}</span>
                  {shots[i] && (
                    <span class={shots[i].accepted ? 'chip chip-good' : 'chip chip-bad'}>
                      {shots[i].accepted ? 'accepted' : 'rejected'}
                    </span>
                  )}
                </li>
              ))}
            </ul>
          )}
          <Checkbox
            label="Accept faces of poor quality"
            checked={anyQuality}
            onChange={setAnyQuality}
            help="Small, blurred, turned or dark faces. One more good image is better."
          />
          {source?.set && (
            <Checkbox
              label="Remove the images from the server afterwards"
              checked={tidy}
              onChange={setTidy}
            />
          )}
          {working && <Progress label="Enrolling" done={working.done} total={working.total} unit="images" />}
          <div class="row row-end">
            <Button disabled={working !== null} onClick={() => setStep('who')}>
              Back
            </Button>
            <AsyncButton
              kind="main"
              disabled={!source || source.references.length === 0 || uploading !== null}
              run={enrol}
            >
              Enrol
            </AsyncButton>
          </div>
        </section>
      )}
      {step === 'done' && (
        <section class="card stack" aria-labelledby="step-done">
          <h2 id="step-done" tabIndex={-1} ref={head}>
            {name.trim()}: {acceptedCount} of {shots.length} images were accepted
          </h2>
          {acceptedCount === 0 && (
            <Notice kind="problem">
              No face was good enough. The table gives the reason for each image and what to change.
            </Notice>
          )}
          {acceptedCount > 0 && acceptedCount < 5 && (
            <Notice>Five or more images make a better template. Add more when you can.</Notice>
          )}
          <Table
            caption="Result of each image"
            stacks
            columns={[
              { name: 'Image', show: (one) => one.name },
              { name: 'Accepted', show: (one) => (one.accepted ? 'yes' : 'no') },
              { name: 'Reason', show: (one) => one.reason || '–' },
            ]}
            rows={shots}
            keyOf={(_, i) => i}
          />
          <div class="row row-end">
            <Button onClick={again}>Enrol another person</Button>
            <Button kind="main" onClick={props.onNext}>
              Identify a face
            </Button>
          </div>
        </section>
      )}
    </div>
  );
}

function thumb(reference: string): string {
  const found = /^(set|job):([^/]+)\/(.+)$/.exec(reference);
  if (!found) return '';
  return found[1] === 'set'
    ? api.setFileAddress(found[2]!, found[3]!, 160)
    : api.jobFileAddress(found[2]!, found[3]!);
}

// The viewer's own camera, one image at a time. Browsers allow it on this machine and over https.
function Camera(props: { onShot: (image: Blob, n: number) => void }) {
  const video = useRef<HTMLVideoElement>(null);
  const stream = useRef<MediaStream | undefined>(undefined);
  const [on, setOn] = useState(false);
  const [problem, setProblem] = useState('');
  const shots = useRef(0);
  const stop = () => {
    for (const track of stream.current?.getTracks() ?? []) track.stop();
    stream.current = undefined;
    setOn(false);
  };
  useEffect(() => stop, []);
  const start = async () => {
    setProblem('');
    if (!navigator.mediaDevices) {
      setProblem(
        'The browser allows the camera only on the studio’s machine, or over https (tarsier serve --tls-self-signed).',
      );
      return;
    }
    try {
      stream.current = await navigator.mediaDevices.getUserMedia({
        video: { width: 1280, facingMode: 'user' },
      });
      setOn(true);
      if (video.current) {
        video.current.srcObject = stream.current;
        await video.current.play();
      }
    } catch {
      setProblem('Camera access was denied, or this device has no camera.');
    }
  };
  const shoot = () => {
    const one = video.current;
    if (!one || one.videoWidth === 0) return;
    const canvas = document.createElement('canvas');
    canvas.width = one.videoWidth;
    canvas.height = one.videoHeight;
    canvas.getContext('2d')?.drawImage(one, 0, 0);
    canvas.toBlob(
      (blob) => {
        if (blob) props.onShot(blob, ++shots.current);
      },
      'image/jpeg',
      0.92,
    );
  };
  return (
    <div class="stack">
      <video ref={video} class={on ? 'shot' : 'unseen'} muted playsInline aria-label="Your camera" />
      <div class="row">
        {!on && <AsyncButton run={start}>Use my camera</AsyncButton>}
        {on && (
          <>
            <Button kind="main" onClick={shoot}>
              Capture an image
            </Button>
            <Button onClick={stop}>Turn the camera off</Button>
          </>
        )}
      </div>
      {problem && <Notice kind="problem">{problem}</Notice>}
    </div>
  );
}
