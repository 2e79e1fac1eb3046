import { PageHead } from '../ui';

export function System() {
  return <PageHead title="System" text="This page is being built." />;
}
