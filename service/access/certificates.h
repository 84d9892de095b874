// Certificates, as far as the service looks at them. PEM text throughout.
#pragma once

#include <string>

#include "service/access/access_table.h"

namespace teletact::service {

// Throws std::runtime_error, one line without the file's name: what cannot be read, or that the key is not
// the (first) certificate's.
void require_pair(const std::string& certificate, const std::string& key);

// When the (first) certificate ends. Throws std::runtime_error for what is none.
WallClock::time_point end_of(const std::string& certificate);

}  // namespace teletact::service
