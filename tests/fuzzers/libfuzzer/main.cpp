// One of the fuzzers, FUZZER, as libFuzzer runs it.
#include <google/protobuf/stubs/logging.h>

#include "tests/fuzzers/client/fuzzers.h"
#include "tests/fuzzers/service/fuzzers.h"

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  google::protobuf::SetLogHandler(nullptr);  // it tells of every field that is no UTF-8
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  teletact::fuzzers::FUZZER({data, size});
  return 0;
}
