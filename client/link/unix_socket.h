// Unix sockets between processes of one person on this machine.
#pragma once

#include <string>

#include "common/file_descriptor.h"

namespace teletact::client {

// A socket that listens at `path`, for this user alone; one that nobody serves any more is taken over.
// Neither it nor what it accepts waits. Throws std::runtime_error, one line that names `flag`.
FileDescriptor listen_at(const char* flag, const std::string& path);
// None when nobody listens there.
FileDescriptor connect_to(const std::string& path);

}  // namespace teletact::client
