#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# --config: values from a file, precedence of the command line, sections for each verb, and errors that name the file.
. "$(dirname "$0")/lib.sh"
mkdir models-a models-b

printf 'models-dir = "models-a"\n' >flat.toml
run models list --config flat.toml
expect_status 0
expect_out 'models-a'

run models list --config=flat.toml --models-dir models-b
expect_status 0
expect_out 'models-b'

printf '# one file for several verbs\n[models.list]\nmodels-dir = "models-b"\njson = true\n[models.verify]\nmodels-dir = "models-a"\n' >sections.toml
run models verify --config sections.toml
expect_status 0
expect_out 'models-a'

printf 'models-dri = "models-a"\n' >typo.toml
run models list --config typo.toml
expect_status 2
expect_error 'typo.toml' "did you mean 'models-dir'"

printf '[models.lits]\nx = 1\n' >section-typo.toml
run models list --config section-typo.toml
expect_status 2
expect_error 'section-typo.toml' 'not an area and verb'

printf 'threads = "many"\n' >bad-value.toml
run doctor --config bad-value.toml
expect_status 2
expect_error 'threads'

run doctor --config missing.toml
expect_status 3
expect_error 'missing.toml'
run doctor --config .
expect_status 3
expect_error '\.:'
run doctor --config
expect_status 2
expect_error 'config'
noise 3000 >noise.toml
run doctor --config noise.toml
[ "$status" -ge 2 ] || fail "noise as a configuration: exit status $status"
expect_error 'noise.toml|config'
finish
