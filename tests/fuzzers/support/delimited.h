// Messages one after the other, each with its length before it, as in a recording.
#pragma once

#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/util/delimited_message_util.h>

#include <optional>

#include "tests/fuzzers/support/boundary.h"

namespace teletact::fuzzers {

class Delimited {
 public:
  explicit Delimited(Bytes bytes) : stream_(bytes.data(), static_cast<int>(bytes.size())) {}

  // None at the end, and where no message follows.
  template <class Message>
  std::optional<Message> next() {
    Message message;
    bool ended = false;
    if (!google::protobuf::util::ParseDelimitedFromZeroCopyStream(&message, &stream_, &ended))
      return std::nullopt;
    return message;
  }

 private:
  google::protobuf::io::ArrayInputStream stream_;
};

}  // namespace teletact::fuzzers
