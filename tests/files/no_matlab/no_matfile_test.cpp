// A client without matio.
#include <gtest/gtest.h>

#include "client/files/matfile.h"
#include "client/files/uff.h"

namespace teletact::client {
namespace {

TEST(NoMatfile, AFileIsRefusedByNameWithTheRemedy) {
  try {
    read_mat("rf.mat", "rf", AxialAxis::kRows);
    FAIL() << "it was read";
  } catch (const FileError& error) {
    const std::string said = error.what();
    EXPECT_EQ(error.path, "rf.mat");
    EXPECT_NE(said.find("rf.mat"), std::string::npos) << said;
    EXPECT_NE(said.find(".mha"), std::string::npos) << said;
    EXPECT_NE(said.find("TELETACT_MATLAB"), std::string::npos) << said;
  }
}

TEST(NoMatfile, SoIsOneOfUstb) {
  try {
    read_uff("b.uff", "", 0);
    FAIL() << "it was read";
  } catch (const FileError& error) {
    const std::string said = error.what();
    EXPECT_EQ(error.path, "b.uff");
    for (const char* words : {"b.uff", ".mha", "TELETACT_MATLAB"})
      EXPECT_NE(said.find(words), std::string::npos) << said;
  }
}

}  // namespace
}  // namespace teletact::client
