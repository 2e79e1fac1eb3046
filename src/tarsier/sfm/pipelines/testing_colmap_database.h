// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/sqlite.h"

namespace tarsier::sfm::test_support {

// A database of COLMAP, to be changed by SQL.
inline DatabaseKind colmap_database_kind() {
  DatabaseKind kind;
  kind.name = "database";
  kind.application_id = 0;
  kind.versions = {""};
  kind.of_another_program = true;
  return kind;
}

}  // namespace tarsier::sfm::test_support
