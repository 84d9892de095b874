// MetaImages as others write them: by ITK 5.4 (tests/files/itk, made by SimpleITK 2.5.7), and as PLUS, SUPRA
// and MetaIO's own writers do.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "client/files/metaimage.h"
#include "tests/files/packed.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"
#include "tests/support/environment.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

fs::path of_itk(const std::string& name) {
  return fs::path(test::required_environment("TELETACT_SOURCE_DIR")) / "tests/files/itk" / name;
}

std::string message_of(const fs::path& path) {
  return refusal_of<FileError>([&] { read_metaimage(path); });
}

TEST(WrittenElsewhere, ItksTypesPackedOrNotAreRead) {
  std::vector<double> counted(12);
  for (std::size_t k = 0; k < 12; ++k) counted[k] = 7.0 * static_cast<double>(k) - 30;
  std::vector<double> above = counted;
  for (double& v : above) v += 100;
  struct Case {
    const char* file;
    ElementType type;
    bool is_unsigned;
  };
  for (const Case& c :
       {Case{"char.mha", ElementType::kInt16, false}, Case{"uchar.mhd", ElementType::kUint8, true},
        Case{"short.mha", ElementType::kInt16, false}, Case{"short_packed.mha", ElementType::kInt16, false},
        Case{"ushort_packed.mha", ElementType::kFloat32, true},
        Case{"int_packed.mhd", ElementType::kFloat64, false}, Case{"uint.mha", ElementType::kFloat64, true},
        Case{"float_packed.mha", ElementType::kFloat32, false},
        Case{"double.mha", ElementType::kFloat64, false}}) {
    const MetaImage image = read_metaimage(of_itk(c.file));
    EXPECT_EQ(image.size, (std::vector<std::size_t>{4, 3})) << c.file;
    EXPECT_NEAR(image.spacing.at(1), 3e-4, 1e-12) << c.file;
    EXPECT_EQ(image.origin.at(0), 0.01) << c.file;
    EXPECT_EQ(image.type, c.type) << c.file;
    EXPECT_EQ(image.as<double>(), c.is_unsigned ? above : counted) << c.file;
  }
}

// A header with these lines before its last.
std::string header(const std::string& lines, const std::string& data = "LOCAL",
                   const std::string& type = "MET_SHORT", const std::string& size = "3 2") {
  return "ObjectType = Image\nNDims = " + std::to_string(1 + std::count(size.begin(), size.end(), ' ')) +
         "\n" + lines + "DimSize = " + size + "\nElementType = " + type + "\nElementDataFile = " + data +
         "\n";
}

const std::string kShorts("\x01\x00\xff\xff\x00\x80\x02\x00\x03\x00\x04\x01", 12);
const std::vector<double> kValues{1, -1, -32768, 2, 3, 260};

TEST(WrittenElsewhere, BothByteOrdersUnderEitherNameAreRead) {
  const TemporaryFolder folder;
  std::string swapped = kShorts;
  for (std::size_t k = 0; k < swapped.size(); k += 2) std::swap(swapped[k], swapped[k + 1]);
  for (const char* line : {"BinaryDataByteOrderMSB = True\n", "ElementByteOrderMSB = true\n"}) {
    put_content(folder / "a.mha", header(line) + swapped);
    EXPECT_EQ(read_metaimage(folder / "a.mha").as<double>(), kValues) << line;
    put_content(folder / "a.mha", header(line + std::string("CompressedData = True\n")) + packed(swapped));
    EXPECT_EQ(read_metaimage(folder / "a.mha").as<double>(), kValues) << line << " packed";
  }
}

// A sequence of PLUS: six fields for each of so many frames, which nothing but their number bounds.
std::string fields_of(std::size_t frames) {
  std::string out;
  for (std::size_t k = 0; k < frames; ++k) {
    const std::string name = "Seq_Frame" + std::to_string(k);
    out += name + "_Timestamp = 0.033\n" + name + "_ImageStatus = OK\n" + name +
           "_ProbeToTrackerTransform = " +
           "0.999 0.001 0.002 123.456 -0.001 0.999 0.003 -45.678 0.002 -0.003 0.999 789.012 0 0 0 1\n";
  }
  return out;
}

TEST(WrittenElsewhere, HeadersOfAnySizeToSixteenMebibytes) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  put_content(path, header("UltrasoundImageType = RF_REAL\n" + fields_of(1000)) + kShorts);  // 150 kB
  const MetaImage image = read_metaimage(path);
  EXPECT_EQ(image.as<double>(), kValues);
  EXPECT_EQ(image.field("UltrasoundImageType"), "RF_REAL");
  EXPECT_EQ(image.field("Seq_Frame999_ImageStatus"), "OK");
  EXPECT_EQ(image.field("Seq_Frame1000_ImageStatus"), "");
  put_content(path, header("Comment = " + std::string(std::size_t{16} << 20, 'a') + "\n") + kShorts);
  EXPECT_NE(message_of(path).find("its header is longer than 16 MiB"), std::string::npos);
  put_content(path, std::string(std::size_t{17} << 20, '\n'));
  EXPECT_NE(message_of(path).find("is not a MetaImage"), std::string::npos) << "whatever its size";
}

TEST(WrittenElsewhere, WhatMetaIoAllowsInAHeaderIsRead) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  for (const char* lines :
       {"HeaderSize = -1\n", "HeaderSize = 0\n", "Comment : with a colon = fine\n",
        "TransformMatrix = 1 0 0 1\nCenterOfRotation = 0 0\n", "\n \r\nComment = after blank lines\n"}) {
    put_content(path, header(lines) + kShorts);
    EXPECT_EQ(read_metaimage(path).as<double>(), kValues) << lines;
  }
  put_content(path, header("ElementSize = 2e-5 3e-4\n") + kShorts);
  EXPECT_EQ(read_metaimage(path).spacing, (std::vector<double>{2e-5, 3e-4})) << "stands for ElementSpacing";
  put_content(path, header("CompressedData = True\nCompressedDataSize = " +
                           std::to_string(packed(kShorts).size()) + "\nHeaderSize = -1\n") +
                        "more" + packed(kShorts));
  EXPECT_EQ(read_metaimage(path).as<double>(), kValues);
}

TEST(WrittenElsewhere, ALineWithoutItsSignIsNamed) {
  const TemporaryFolder folder;
  put_content(folder / "a.mha", header("Comment = a first line\nand a second\n") + kShorts);
  EXPECT_NE(message_of(folder / "a.mha").find("header line 'and a second' has no '='; delete it"),
            std::string::npos)
      << message_of(folder / "a.mha");
}

TEST(WrittenElsewhere, DataInAFileBesideTheHeaderAreRead) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mhd";
  put_content(folder / "a.raw", kShorts);
  put_content(folder / "long.raw", "sixteen bytes...." + kShorts);
  put_content(folder / "a.zraw", packed(kShorts));
  put_content(path, header("", "a.raw"));
  EXPECT_EQ(read_metaimage(path).as<double>(), kValues);
  put_content(path, header("HeaderSize = 17\n", "long.raw"));
  EXPECT_EQ(read_metaimage(path).as<double>(), kValues);
  put_content(path, header("CompressedData = True\n", "a.zraw"));
  EXPECT_EQ(read_metaimage(path).as<double>(), kValues);
  put_content(path, header("", "long.raw"));
  EXPECT_NE(message_of(path).find("long.raw: its header declares 12 bytes of samples but 29 follow"),
            std::string::npos)
      << message_of(path);
  put_content(path, header("", "absent.raw"));
  EXPECT_NE(message_of(path).find("absent.raw: does not exist"), std::string::npos);
}

// A header from elsewhere names no other files of this person.
TEST(WrittenElsewhere, DataElsewhereOrInSeveralFilesAreRefused) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mhd";
  for (const char* name : {"/etc/passwd", "../a.raw", "..", "LIST", "a%03d.raw 1 4 1", ""}) {
    put_content(path, header("", name));
    EXPECT_NE(message_of(path).find("is not one file beside this one"), std::string::npos)
        << name << ": " << message_of(path);
  }
}

TEST(WrittenElsewhere, PackedSamplesThatAreDamagedAreRefused) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  const std::string whole = packed(kShorts), packed_header = header("CompressedData = True\n");
  std::string flipped = whole;
  flipped[whole.size() - 1] = static_cast<char>(flipped[whole.size() - 1] ^ 1);
  for (const std::string& data : {whole.substr(0, whole.size() - 5), std::string("no zlib at all"), flipped,
                                  packed(kShorts + "more"), packed(kShorts.substr(2))}) {
    put_content(path, packed_header + data);
    EXPECT_NE(message_of(path).find("its packed samples are damaged"), std::string::npos) << message_of(path);
  }
  put_content(path, header("CompressedData = True\n", "LOCAL", "MET_SHORT", "16000000 16000000 4") + whole);
  EXPECT_NE(message_of(path).find("truncated"), std::string::npos) << "before anything is allocated";
}

TEST(WrittenElsewhere, FourDimensionsAreReadWhereTheThirdIsOne) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  const std::string four = kShorts + kShorts + kShorts + kShorts;
  put_content(path, header("ElementSpacing = 2 3 4 5\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n", "LOCAL",
                           "MET_SHORT", "3 2 1 4") +
                        four);
  const MetaImage image = read_metaimage(path);
  EXPECT_EQ(image.size, (std::vector<std::size_t>{3, 2, 4}));
  EXPECT_EQ(image.spacing, (std::vector<double>{2, 3, 5}));
  put_content(path, header("", "LOCAL", "MET_SHORT", "3 1 2 4") + four);
  EXPECT_NE(message_of(path).find("NDims is 4"), std::string::npos) << message_of(path);
}

TEST(WrittenElsewhere, ThirtyTwoBitsAreKeptToTheLast) {
  const TemporaryFolder folder;
  const fs::path path = folder / "a.mha";
  const std::string bytes(
      "\xff\xff\xff\xff\x01\x00\x00\x80\x00\x00\x00\x00\xff\xff\xff\x7f\x01\x00\x00\x00\x02\x00\x00\x00", 24);
  for (const char* type : {"MET_INT", "MET_LONG"}) {
    put_content(path, header("", "LOCAL", type) + bytes);
    EXPECT_EQ(read_metaimage(path).as<double>(), (std::vector<double>{-1, -2147483647, 0, 2147483647, 1, 2}))
        << type;
  }
  for (const char* type : {"MET_UINT", "MET_ULONG"}) {
    put_content(path, header("", "LOCAL", type) + bytes);
    EXPECT_EQ(read_metaimage(path).as<double>(),
              (std::vector<double>{4294967295, 2147483649, 0, 2147483647, 1, 2}))
        << type;
  }
}

}  // namespace
}  // namespace teletact::client
