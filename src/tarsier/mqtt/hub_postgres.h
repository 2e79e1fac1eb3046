// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/hub_log.h"

#include <memory>
#include <string>

namespace tarsier::mqtt {

// Whether this machine has libpq: its version ("15.5"), or an empty string; `reason` then says what
// to do.
[[nodiscard]] std::string libpq_version(std::string& reason);

// The same tables as of the SQLite file, in the database's first schema of its search path, and
// hub_version beside them. A server that goes away is waited for, 20 s at most. See open_hub_log().
[[nodiscard]] std::unique_ptr<HubLog> open_postgres_hub_log(const std::string& address,
                                                            DatabaseAccess access);

}  // namespace tarsier::mqtt
