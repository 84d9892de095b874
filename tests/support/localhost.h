// Whether this machine knows localhost by name: one without /etc/hosts, such as a folder that debootstrap
// made, may not.
#pragma once

#include <netdb.h>

namespace teletact::test {

inline bool knows_localhost() {
  addrinfo* found = nullptr;
  if (::getaddrinfo("localhost", nullptr, nullptr, &found) != 0) return false;
  ::freeaddrinfo(found);
  return true;
}

}  // namespace teletact::test
