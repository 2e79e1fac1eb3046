// One model: its cloud, its images with reasons, measures, downloads.
import { useEffect, useState } from 'preact/hooks';
import { api, errorText, type Job } from '../../api';
import { bytesText } from '../../format';
import { useLoad } from '../../hooks';
import { Notice, Progress, Table } from '../../ui';
import { jobJson } from '../shared/jobs';
import { CloudPanel } from './cloud_panel';
import type { Model } from './model';

interface ImageRow {
  name: string;
  registered: boolean;
  model?: number;
  points?: number;
  reason?: string;
  read?: boolean;
}

interface Report {
  models: {
    points: number;
    observations: number;
    mean_track: number;
    reprojection_px: number;
  }[];
  images?: ImageRow[];
  photographs?: ImageRow[]; // the same, in reports of older programs
  partial?: boolean;
  not_placed?: string;
  log?: string[];
}

// Not what only the program itself reads again, an image or a depth map each.
const isResult = (name: string) =>
  !name.includes('/cache/') && !/\/dense\/(images|stereo|sparse)\//.test(name);

export function ModelView({ job }: { job: Job }) {
  const report = useLoad(() => jobJson<Report>(job.id, 'model/report.json'), [job.id]);
  const [model, setModel] = useState<Model | null>(null);
  const [problem, setProblem] = useState('');
  useEffect(() => {
    const stop = new AbortController();
    const at = (file: string) => api.jobFileAddress(job.id, `model/${file}`);
    import('./worker')
      .then(({ readModel }) =>
        readModel(at('cameras.txt'), at('images.txt'), at('points3D.txt'), stop.signal),
      )
      .then(setModel, (why: unknown) => {
        if (!stop.signal.aborted) setProblem(errorText(why));
      });
    return () => stop.abort();
  }, [job.id]);

  const main = report.value?.models[0];
  const images = report.value?.images ?? report.value?.photographs ?? [];
  const missing = images.filter((one) => !one.registered);
  return (
    <section class="stack" aria-labelledby="the-model">
      <h2 id="the-model">{job.name || 'The model'}</h2>
      {report.value?.partial && <Notice>The job was stopped. This is the partial model.</Notice>}
      {main && (
        <p class="numbers">
          {images.filter((one) => one.model === 0).length} of {images.length} images, {main.points} points,
          each observed in {main.mean_track.toFixed(1)} images, reprojection error{' '}
          {main.reprojection_px.toFixed(2)} px
          {report.value!.models.length > 1 ? `; ${report.value!.models.length - 1} further models` : ''}
        </p>
      )}
      {report.error && <Notice kind="problem">{report.error}</Notice>}
      {problem && <Notice kind="problem">The cloud could not be shown. {problem}</Notice>}
      {!model && !problem && <Progress label="Loading the model" done={0} total={0} />}
      {model && <CloudPanel job={job} model={model} />}
      {missing.length > 0 && (
        <Notice kind="problem">
          <p>
            {missing.length} {missing.length === 1 ? 'image is' : 'images are'} not in the model:
          </p>
          <ul>
            {missing.map((one) => (
              <li key={one.name}>
                {one.name}: {one.reason ?? (one.read === false ? 'could not be read' : 'unknown reason')}
              </li>
            ))}
          </ul>
        </Notice>
      )}
      {report.value && (
        <details open={missing.length > 0}>
          <summary>All images</summary>
          <Table
            caption="Images of the model"
            columns={[
              { name: 'Image', show: (one) => one.name },
              { name: 'In the model', show: (one) => (one.registered ? 'yes' : 'no') },
              { name: 'Points', show: (one) => one.points ?? '', number: true },
              { name: 'Reason', show: (one) => one.reason ?? '' },
            ]}
            rows={images}
            keyOf={(one) => one.name}
          />
        </details>
      )}
      {(report.value?.log?.length ?? 0) > 0 && (
        <details>
          <summary>Log of the reconstruction</summary>
          <ol class="log-list">
            {report.value!.log!.map((line, i) => (
              <li key={i}>{line}</li>
            ))}
          </ol>
        </details>
      )}
      <details>
        <summary>Files for other programs</summary>
        <ul class="file-list">
          {job.files
            .filter((file) => isResult(file.name))
            .map((file) => (
              <li key={file.name}>
                <a href={api.jobFileAddress(job.id, file.name)} download={file.name.split('/').pop()}>
                  {file.name}
                </a>{' '}
                <span class="faint">{bytesText(file.bytes)}</span>
              </li>
            ))}
        </ul>
        <p class="field-help">
          cameras.txt, images.txt and points3D.txt are COLMAP's text model; points.ply and dense/fused.ply
          open in MeshLab and CloudCompare, mesh.glb in browsers, Blender and most viewers of glTF.
        </p>
      </details>
    </section>
  );
}
