// The kind of the error that a call ends with.
#pragma once

#include <gtest/gtest.h>

#include <functional>

#include "service/scene/errors.h"

namespace teletact::service {

inline ErrorKind kind_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.kind;
  }
  ADD_FAILURE() << "ended well";
  return ErrorKind::kNotFound;
}

}  // namespace teletact::service
