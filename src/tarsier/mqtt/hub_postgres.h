// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/hub_log.h"

#include <memory>
#include <string>

namespace tarsier::mqtt {

// The version of libpq on this machine ("15.5"). Empty if it is missing; `reason` then says what to
// do.
[[nodiscard]] std::string libpq_version(std::string& reason);

// The same tables as in the SQLite file, in the first schema of the database's search path, and
// hub_version. Waits at most 20 s for a server that is not available. See open_hub_log().
[[nodiscard]] std::unique_ptr<HubLog> open_postgres_hub_log(const std::string& address,
                                                            DatabaseAccess access);

}  // namespace tarsier::mqtt
