import { PageHead } from '../ui';

export function Plates() {
  return <PageHead title="Plates" text="This page is being built." />;
}
