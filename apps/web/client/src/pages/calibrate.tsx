import { PageHead } from '../ui';

export function Calibrate() {
  return <PageHead title="Calibrate" text="This page is being built." />;
}
