// What a call says when it refuses.
#pragma once

#include <string>

namespace teletact::client {

template <class Error, class Call>
std::string refusal_of(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

}  // namespace teletact::client
