// Certificates, as far as the service looks at them, and the making of a few for a trial. PEM text
// throughout.
#pragma once

#include <string>
#include <vector>

#include "service/access/access_table.h"

namespace teletact::service {

// Throws std::runtime_error, one line without the file's name: what cannot be read, or that the key is not
// the (first) certificate's.
void require_pair(const std::string& certificate, const std::string& key);

// When the (first) certificate ends. Throws std::runtime_error for what is none.
WallClock::time_point end_of(const std::string& certificate);

struct Identity {
  std::string certificate, key;
};

// A certificate of its own that signs others; elliptic keys of the curve P-256, as all here. All throw
// std::runtime_error where the cryptographic library fails.
Identity make_authority(const std::string& name, WallClock::time_point end);
// For a service at `hosts`, names or addresses.
Identity make_server(const Identity& authority, const std::vector<std::string>& hosts,
                     WallClock::time_point end);
// For a client of this name.
Identity make_client(const Identity& authority, const std::string& name, WallClock::time_point end);

}  // namespace teletact::service
