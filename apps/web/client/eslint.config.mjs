import tseslint from 'typescript-eslint';

export default tseslint.config({ ignores: ['node_modules/**'] }, ...tseslint.configs.recommended, {
  files: ['src/**/*.{ts,tsx}'],
  rules: {
    '@typescript-eslint/no-explicit-any': 'error',
    'no-restricted-syntax': [
      'error',
      // The page's security policy allows neither; names from files and people are shown as text only.
      { selector: "JSXAttribute[name.name='dangerouslySetInnerHTML']", message: 'Show text as text.' },
      { selector: "MemberExpression[property.name='innerHTML']", message: 'Show text as text.' },
    ],
    'no-eval': 'error',
    'no-implied-eval': 'error',
    eqeqeq: 'error',
  },
});
