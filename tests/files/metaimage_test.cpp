#include "client/files/metaimage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <numeric>

#include "tests/files/short_disk.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

std::string message_of(const fs::path& path) {
  try {
    read_metaimage(path);
  } catch (const FileError& error) {
    EXPECT_EQ(error.path.parent_path(), path.parent_path());
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << "one line";
    EXPECT_NE(std::string(error.what()).find(error.path.string()), std::string::npos);
    return error.what();
  }
  return "no error";
}

template <class T>
class MetaImageOf : public testing::Test {};
using ElementTypes = testing::Types<std::uint8_t, std::int16_t, float, double>;
TYPED_TEST_SUITE(MetaImageOf, ElementTypes);

TYPED_TEST(MetaImageOf, ReadsBackWhatWasWritten) {
  const TemporaryFolder folder;
  std::vector<TypeParam> samples(7 * 5 * 3 * 2);
  for (std::size_t i = 0; i < samples.size(); ++i) samples[i] = static_cast<TypeParam>(i * 1.25);
  const auto written = MetaImage::of<TypeParam>({7, 5, 3}, {1.925e-05, 1.0 / 3, 2}, {.1, -.2, 0}, samples, 2);
  write_metaimage(folder / "a.mha", written);
  const MetaImage read = read_metaimage(folder / "a.mha");
  EXPECT_EQ(read.size, written.size);
  EXPECT_EQ(read.spacing, written.spacing);
  EXPECT_EQ(read.origin, written.origin);
  EXPECT_EQ(read.channels, 2u);
  EXPECT_EQ(read.type, written.type);
  EXPECT_EQ(read.data, written.data);
  EXPECT_EQ(read.as<TypeParam>(), samples);
}

TEST(MetaImage, LeavesWhatTheFileDoesNotStateEmpty) {
  const TemporaryFolder folder;
  const std::vector<float> samples(6, 1.5f);
  write_metaimage(folder / "a.mha", MetaImage::of<float>({3, 2}, {}, {}, samples));
  const MetaImage read = read_metaimage(folder / "a.mha");
  EXPECT_TRUE(read.spacing.empty());
  EXPECT_TRUE(read.origin.empty());
  EXPECT_EQ(read.as<double>(), std::vector<double>(6, 1.5));
}

TEST(MetaImage, ConvertsShortsAndKeepsNaN) {
  const TemporaryFolder folder;
  const std::vector<std::int16_t> shorts{-32768, -1, 0, 32767};
  write_metaimage(folder / "s.mha", MetaImage::of<std::int16_t>({2, 2}, {}, {}, shorts));
  EXPECT_EQ(read_metaimage(folder / "s.mha").as<float>(), (std::vector<float>{-32768, -1, 0, 32767}));
  const std::vector<float> floats{0, std::numeric_limits<float>::quiet_NaN(), 1, 2};
  write_metaimage(folder / "f.mha", MetaImage::of<float>({2, 2}, {}, {}, floats));
  EXPECT_TRUE(std::isnan(read_metaimage(folder / "f.mha").as<float>()[1]));
}

// A valid header, with one line replaced or added.
std::string header_with(const std::string& key, const std::string& line) {
  const std::vector<std::pair<std::string, std::string>> lines{
      {"NDims", "NDims = 2"},
      {"CompressedData", "CompressedData = False"},
      {"TransformMatrix", "TransformMatrix = 1 0 0 1"},
      {"ElementSpacing", "ElementSpacing = 1 1"},
      {"DimSize", "DimSize = 3 2"},
      {"ElementType", "ElementType = MET_SHORT"},
      {"ElementDataFile", "ElementDataFile = LOCAL"}};
  std::string out = "ObjectType = Image\n";
  bool replaced = false;
  for (const auto& [name, text] : lines) {
    if (name == "ElementDataFile" && !replaced && key != name) out += line.empty() ? "" : line + "\n";
    if (name == key) replaced = true;
    const std::string& chosen = name == key ? line : text;
    if (!chosen.empty()) out += chosen + "\n";
  }
  return out;
}

TEST(MetaImage, RefusesWhatItCannotReadFaithfully) {
  const TemporaryFolder folder;
  const fs::path path = folder / "bad.mha";
  const std::string samples(12, '\0');
  struct Case {
    const char *key, *line, *expected;
  };
  for (const Case& c : std::vector<Case>{
           {"BinaryData", "BinaryData = False", "save it as binary"},
           {"TransformMatrix", "Orientation = 0 1 1 0", "Orientation"},
           {"TransformMatrix", "Rotation = 0 1 1 0", "Rotation"},
           {"TransformMatrix", "TransformMatrix = 0 1 1 0", "TransformMatrix"},
           {"ElementSpacing", "ElementSpacing = 1 0", "ElementSpacing"},
           {"ElementSpacing", "ElementSpacing = 1 nan", "ElementSpacing"},
           {"ElementSpacing", "ElementSpacing = 1", "ElementSpacing"},
           {"DimSize", "DimSize = 3 -2", "DimSize"},
           {"DimSize", "DimSize = 3 2.5", "DimSize"},
           {"DimSize", "DimSize = 3 x", "DimSize"},
           {"DimSize", "", "DimSize"},
           {"DimSize", "DimSize = 3 3", "truncated"},
           {"DimSize", "DimSize = 3 1", "corrupt"},
           {"DimSize", "DimSize = 16000000 16000000", "truncated"},
           {"DimSize", "DimSize = 1e300 2", "DimSize"},
           {"NDims", "NDims = 7", "NDims"},
           {"NDims", "NDims = 1", "NDims"},
           {"ElementType", "ElementType = MET_ULONG_LONG", "MET_FLOAT"},
           {"ElementNumberOfChannels", "ElementNumberOfChannels = 0", "ElementNumberOfChannels"},
           {"Extra", "DimSize = 3 2", "twice"},
           {"ElementDataFile", "ElementDataFile = other.raw", "does not exist"},
           {"ElementDataFile", "", "ElementDataFile"}}) {
    put_content(path, header_with(c.key, c.line) + samples);
    EXPECT_NE(message_of(path).find(c.expected), std::string::npos) << c.line << " -> " << message_of(path);
  }
  put_content(path, header_with("none", "") + samples);
  EXPECT_EQ(message_of(path), "no error")
      << "the untouched header must be readable, else the cases prove nothing";
}

TEST(MetaImage, NamesFilesThatAreNone) {
  const TemporaryFolder folder;
  EXPECT_NE(message_of(folder / "absent.mha").find("does not exist"), std::string::npos);
  EXPECT_NE(message_of(folder / "").find("not a file"), std::string::npos);
  put_content(folder / "empty.mha", "");
  EXPECT_NE(message_of(folder / "empty.mha").find("MetaImage"), std::string::npos);
  put_content(folder / "noise.mha", std::string(200000, '\x07'));
  EXPECT_NE(message_of(folder / "noise.mha").find("MetaImage"), std::string::npos);
}

TEST(MetaImage, RefusesAFolderThatCannotBeWritten) {
  const TemporaryFolder folder;
  const std::vector<float> samples(4);
  const auto image = MetaImage::of<float>({2, 2}, {}, {}, samples);
  try {
    write_metaimage(folder / "absent" / "a.mha", image);
    FAIL();
  } catch (const FileError& error) {
    EXPECT_NE(std::string(error.what()).find("cannot be written"), std::string::npos) << error.what();
  }
  EXPECT_THROW(MetaImage::of<float>({3, 2}, {}, {}, samples), std::invalid_argument);
}

TEST(MetaImage, FullDiskKeepsTheFileThatWasThere) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  const std::vector<float> former{1, 2, 3, 4}, larger(1 << 14);
  write_metaimage(path, MetaImage::of<float>({2, 2}, {}, {}, former));
  {
    const ShortDisk disk(4096);
    EXPECT_THROW(write_metaimage(path, MetaImage::of<float>({1 << 7, 1 << 7}, {}, {}, larger)), FileError);
  }
  EXPECT_EQ(read_metaimage(path).as<float>(), former);
  EXPECT_EQ(std::distance(fs::directory_iterator(path.parent_path()), {}), 1) << "nothing else is left";
}

TEST(MetaImage, ReadsRecordingsNobodyHereMade) {
  const char* source = std::getenv("TELETACT_SOURCE_DIR");
  const fs::path data = fs::path(source == nullptr ? "." : source) / ".." / "shared" / "data";
  if (!fs::exists(data)) GTEST_SKIP() << "no data folder at " << data;
  const MetaImage phantom = read_metaimage(data / "phantom-s2000" / "pre.mha");
  EXPECT_EQ(phantom.size, (std::vector<std::size_t>{2856, 312}));
  EXPECT_EQ(phantom.type, ElementType::kInt16);
  EXPECT_DOUBLE_EQ(phantom.spacing.at(0), 1.925e-05);
  const MetaImage truth = read_metaimage(data / "simulated-inclusion" / "truth_displacement.mha");
  EXPECT_EQ(truth.channels, 2u);
  EXPECT_DOUBLE_EQ(truth.origin.at(0), 0.0051109);
  const auto u = truth.as<double>();
  const double top = u[0], bottom = u[2 * 399];  // axial component, first line
  EXPECT_NEAR(top, 1.1e-3, 2e-4) << "largest at the top (LAB)";
  EXPECT_LT(std::abs(bottom), top);
}

}  // namespace
}  // namespace teletact::client
