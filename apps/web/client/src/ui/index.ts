export * from './controls';
export * from './job_card';
export * from './live_view';
export * from './start_dialog';
export * from './toast';
export * from './verb_form';
