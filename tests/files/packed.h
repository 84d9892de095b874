// Bytes as zlib packs them, for files that hold such.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <string>

namespace teletact::client {

inline std::string packed(const std::string& bytes) {
  uLongf size = compressBound(bytes.size());
  std::string out(size, '\0');
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(out.data()), &size,
                     reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()),
            Z_OK);
  out.resize(size);
  return out;
}

}  // namespace teletact::client
