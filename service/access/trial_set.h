// What a trial installation needs to know who calls: an authority, a certificate of the service, a
// certificate and a token of each role, and the file of access that knows them.
#pragma once

#include <filesystem>
#include <string>

#include "service/access/access_table.h"

namespace teletact::service {

// Into `folder`, which is made (0700) or empty; all files are 0600: ca.pem, ca-key.pem, server.pem,
// server-key.pem, ROLE.pem, ROLE-key.pem, ROLE.token and access.toml. `host`: the name or address that
// clients connect to, beside localhost. Throws std::runtime_error, one line: a folder that is not empty or
// cannot be written, a host that is none.
void make_trial_set(const std::filesystem::path& folder, const std::string& host, WallClock::time_point end);

}  // namespace teletact::service
