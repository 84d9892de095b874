// Failures that a caller can act on, apart from bad fields (those are std::invalid_argument with the field's
// name). rpc/status.cpp turns each kind into one canonical code.
#pragma once

#include <stdexcept>
#include <string>

#include "service/base/shown.h"

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

struct Error : std::runtime_error {
  Error(ErrorKind kind_, const std::string& what) : std::runtime_error(what), kind(kind_) {}
  ErrorKind kind;
};

}  // namespace teletact::service
