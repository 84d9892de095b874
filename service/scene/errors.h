// Failures that a caller can act on, apart from bad fields (those are std::invalid_argument with the field's
// name). rpc/status.cpp turns each kind into one canonical code.
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace teletact::service {

enum class ErrorKind {
  kNotFound,       // no such scene
  kAlreadyExists,  // scene id taken
  kExhausted,      // a stated limit is reached
  kPrecondition,   // the state does not allow it
  kAborted,        // the scene was deleted meanwhile
  kUnavailable,    // starting or draining
  kCancelled,      // the caller went away
  kDeadline,       // took longer than was allowed
};

// A client's text as messages and logs may show it: printable, without quotes, at most 64 bytes. (gRPC drops
// a status whose message is longer than a few KB; a line of the log must stay one line.)
inline std::string shown(std::string_view text) {
  constexpr std::size_t kMost = 64;
  std::string out(text.substr(0, kMost));
  for (char& c : out)
    if (c < ' ' || c > '~' || c == '"') c = '?';
  return text.size() > kMost ? out + "..." : out;
}

struct Error : std::runtime_error {
  Error(ErrorKind kind_, const std::string& what) : std::runtime_error(what), kind(kind_) {}
  ErrorKind kind;
};

}  // namespace teletact::service
