// SPDX-License-Identifier: Apache-2.0
// Results of the format readers for recording.cpp. Private to this folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "jade/recording/recording.h"

namespace jade::recording {

/// A temporary folder for one conversion, removed with its content by its last owner.
class TemporaryFolder {
 public:
  /// @throws DataError if it cannot be created.
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// A temporary folder, which is deleted before the user reads a message, and what it was made from.
struct Made {
  std::filesystem::path folder, original;
  bool keeps_names = true;  ///< files of the folder have the names that they have in `original`
};

/// The line about the original instead of a temporary file.
std::string renamed(const std::vector<Made>& made, std::string line);

/// An image file that has not been read yet.
struct FrameFile {
  std::filesystem::path path;
  /// Time span of its exposure; start and end are equal if only one time is known. No value: no
  /// time.
  std::optional<events::TimeWindow> time;
  bool has_named_time = false;  ///< whether the time is the file's name
};

/// Time spans of a recording's clock, sorted and disjoint; no value: all of it.
using Kept = std::optional<std::vector<events::TimeWindow>>;

/// Events to read, known once the frames have their exposures.
struct Wanted {
  Kept kept;
  /// From the first frame to the last, by a clock that may be another one than that of the events.
  std::optional<events::TimeWindow> frames;
};

/// Adds the events of these spans, and notes about them, to a recording.
using ReadEvents = std::function<void(const Wanted& wanted, Recording& recording)>;

/// A recording whose images are still files, and whose events are not read yet.
struct Contents {
  Recording recording;  ///< without frames and events
  std::vector<FrameFile> files;
  ReadEvents read_events;                 ///< empty: there are no events
  std::shared_ptr<TemporaryFolder> keep;  ///< folder of the files, if it is temporary
  std::vector<Made> made;                 ///< `keep`, for messages
};

Contents read_zip(const std::filesystem::path& path, const ReadOptions& options);
Contents read_event_folder(const std::filesystem::path& folder, const ReadOptions& options);
/// Reads a temporary folder of frames and events. @throws DataError naming its original.
Contents read_made(const Made& made, const ReadOptions& options);
Contents read_evt(const std::filesystem::path& path, const ReadOptions& options);
Contents read_dat(const std::filesystem::path& path, const ReadOptions& options);
Contents read_converted(const std::filesystem::path& path, const ReadOptions& options);
/// Last line that a failed program printed; empty if none.
std::string last_line(const std::filesystem::path& log);
/// Whether the file has Metavision's records and no other group is requested.
bool is_metavision(const std::filesystem::path& path, const std::string& group);
Contents read_metavision(const std::filesystem::path& path, const ReadOptions& options);
/// HDF5, .npz, .npy and text files with events only.
Contents read_event_file(const std::filesystem::path& path, const ReadOptions& options);

/// Adds the pictures, with their times, that an HDF5 file contains for the camera of its events,
/// and notes those of others.
void add_hdf5_frames(const std::filesystem::path& path, const ReadOptions& options,
                     Contents& contents);

/// Gives each image the exposure that `exposures` contains for its name, and warns of exposures
/// without an image. Accents of names may be in another form than the files'. Of several lines with
/// one file name, the folders in the line decide.
/// @throws DataError if an image has none or several, and as check_apart().
void apply_exposures(const std::filesystem::path& list, const std::vector<NamedExposure>& exposures,
                     std::vector<FrameFile>& files, Recording& recording);

/// Whether an exposure is about a stamp of 0, which drivers without a clock write.
inline bool may_lack_stamp(const events::TimeWindow& exposure) {
  return exposure.begin_us <= 0 && exposure.end_us >= 0;
}

/// Checks that exposures of one camera do not overlap, unless all may lack a stamp. Warns of
/// lengths of at most a thousandth of the frame period. Tolerates overlaps of a twentieth of the
/// frame period, and longer ones of a tenth of the frames, of which it warns.
/// @throws DataError naming `list` and two frames with the same exposure, and for exposures that
///   are too long for µs.
void check_apart(const std::filesystem::path& list, const std::vector<FrameFile>& files,
                 Recording& recording);

/// Reads images on several threads into recording.frames, sorted by time; skips those without a
/// time.
/// @throws DataError if one cannot be read, they differ in size, or they do not fit into memory.
void read_frames(std::vector<FrameFile> files, Recording& recording);

/// Images directly in a folder; 0 also for one that is missing or may not be read.
size_t count_images(const std::filesystem::path& folder);

/// Folders below this one with images, sorted; not of masks.
std::vector<std::filesystem::path> image_folders(const std::filesystem::path& folder);

/// A mask for all frames beside them, not a frame.
bool is_mask_of_all(const std::filesystem::path& image);

/// The images of a folder, with the times of the first list that it, `root` or a folder between
/// them has: exposures.csv, timestamps.npz, images.txt, which also says which images, those of
/// add_frame_list(), or the names; else of images.txt or FOLDER.txt in list_folders(), if it lists
/// all images in their order. Without these, and with options.frame_times, images have no times.
/// Warns if images.txt or timestamps.npz differs from exposures.csv.
/// @param images,root  as for add_frame_list(); empty images: only those of images.txt
std::vector<FrameFile> timed_images(const std::filesystem::path& images,
                                    const std::filesystem::path& root, const ReadOptions& options,
                                    Recording& recording);

/// Notes the right camera of a stereo recording in a folder, which is not read.
/// @param read  images and events of the left one, or empty
void note_right_camera(const std::filesystem::path& folder,
                       const std::vector<std::filesystem::path>& read, Recording& recording);

/// Replaces the recording's frames by the images of a folder, the pages of a TIFF or the frames of
/// a video. A folder may contain exposures.csv, images.txt or timestamps.npz; frames of a video
/// have its own clock, which starts at 0.
/// @throws DataError for a folder without images, a video that ffmpeg cannot read.
void replace_frames(const std::filesystem::path& path, const ReadOptions& options,
                    Contents& contents);

/// Notes names in `list` whose accents are stored in another form than those of the files.
void note_respelled(const std::filesystem::path& list, const std::vector<std::string>& names,
                    std::vector<std::string>& notes);

/// Warns if a recording's folder has images only in a folder below it that is not read, or files of
/// another kind.
void warn_of_no_images(const std::filesystem::path& folder, Recording& recording);

/// Reads images.txt: one line per image with a time and a path, which may have blanks. Times are in
/// seconds; whole numbers more than 1000 apart on average are µs or ns, which is noted. Warns of
/// images that are listed twice or missing, and unlisted ones of the folder; all are skipped.
/// @throws DataError naming the line.
std::vector<FrameFile> listed_images(const std::filesystem::path& list, Recording& recording);

/// Assigns the times of timestamps.npz to images sorted by name.
/// @throws DataError if their numbers differ.
void add_npz_times(const std::filesystem::path& path, events::TimeUnit unit,
                   std::vector<FrameFile>& files, Recording& recording);

/// Assigns the times of a list of numbers that DSEC, EDS or TUM-VIE have beside the frames, one
/// line per frame in the order of names; of a part of the frames, each has the line of its number.
/// Times are in us, or in the unit in which frames are 0.2 ms to 2 s apart, with a note. Without
/// a list, names that are times, as those of TUM's and EuRoC's frames. False if there are neither.
/// @param images  their folder
/// @param root    the recording's folder, above which no list is searched; empty: no limit
/// @throws DataError naming the list and its line, or the frame without one.
bool add_frame_list(const std::filesystem::path& images, const std::filesystem::path& root,
                    const ReadOptions& options, std::vector<FrameFile>& files,
                    Recording& recording);

/// Folders that may have lists of the images: theirs and those above it, up to the root or, without
/// one, two while names have words of public data sets.
std::vector<std::filesystem::path> list_folders(const std::filesystem::path& images,
                                                const std::filesystem::path& root);

/// The tests of std::filesystem without its exceptions: false for links in a loop and folders that
/// may not be entered.
bool is_file(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);

/// The number that a word is; no value for other words.
std::optional<double> number_in(const std::string& word);

/// The unit in which times of frames are since 1970 or, as a second choice, 0.2 ms to 2 s apart.
std::optional<events::TimeUnit> likely_unit(const std::vector<double>& times);

/// Assigns the times that names of frames are: numbers since 1970, with a decimal point, or far
/// apart; not numbers that count. Other names, a tenth at most but always one, are left out with a
/// warning. False if names are no times.
bool add_times_of_names(const std::filesystem::path& images, const ReadOptions& options,
                        std::vector<FrameFile>& files, Recording& recording);

/// Assigns the times of a list without names. A line has a frame's time, its number and time, or
/// the start and end of its exposure; order and units as in add_frame_list(). False if the list has
/// names.
/// @throws DataError as add_frame_list()
bool apply_numbers(const std::filesystem::path& path, const ReadOptions& options,
                   std::vector<FrameFile>& files, Recording& recording);

/// Assigns the times of a list with one time and one name per line, in either order, as TUM's and
/// EuRoC's lists have them; units as in add_frame_list(). False for other lists.
/// @throws DataError naming a line of another kind, or a frame without one.
bool apply_named_times(const std::filesystem::path& path, const ReadOptions& options,
                       std::vector<FrameFile>& files, Recording& recording);

/// From the first exposure to the last, by a clock that is ahead by the offset; no value: no file
/// has a time.
std::optional<events::TimeWindow> span_of(const std::vector<FrameFile>& files, int64_t ahead_us);

/// Completes exposures from options and trigger edges if the recording's fields lack them.
/// @throws DataError for frames of other sources that remain without a time, and naming two frames
///   with the same time.
void complete_exposures(const ReadOptions& options, Contents& contents);

/// Selects the channel of the trigger input with the most edges, and notes the others.
void choose_channel(const std::filesystem::path& path, const std::map<int64_t, Triggers>& channels,
                    Recording& recording);

/// Returns a reader of a file's events; data beside them, such as triggers, are added to
/// `recording` at once.
/// @param exposures  that determine the time unit if the file does not
ReadEvents events_of(const std::filesystem::path& path, const ReadOptions& options,
                     const std::optional<events::TimeWindow>& exposures, Recording& recording);
ReadEvents events_of_evt(const std::filesystem::path& path, const ReadOptions& options,
                         Recording& recording);

/// Sets how many events were stored, and notes how many were skipped.
/// @param most  maximum number to keep, 0: all
void note_stored(int64_t events, const events::TimeWindow& span_us, int64_t most,
                 Recording& recording);

}  // namespace jade::recording
