#!/usr/bin/env python3
"""Writes one HTML page about an output folder, or without a folder about NASA CR-178199.

The page about the paper computes what is missing (reproduce all). Every result is read from the
outputs.
"""

from pathlib import Path

import plotting as p
import command_page
import paper_page
from output_folder import Outputs
from program import run, tell, write_text


def page_of(folder, cases):
    """Returns the page about a folder: the paper, a part of it, or a command."""
    if (folder / "table-4.1").exists():
        return paper_page.Page(folder).document()
    outputs = Outputs(folder, cases)
    part = next((command for command in outputs.commands() if command in paper_page.PARTS), None)
    if part:
        return paper_page.part_document(outputs, part)
    return command_page.document(outputs)


def main():
    parser = p.new_parser(__doc__.split("\n")[0])
    parser.add_argument("folder", nargs="?", default="out", help="outputs of a command, or of "
                        "`reproduce all` (default: out)")
    parser.add_argument("--case", metavar="FILE", nargs="+", default=[], help="case files to show "
                        "(default: the copy in the folder)")
    parser.add_argument("--out", metavar="FILE", help="page to write (default: FOLDER/report.html)")
    arguments = parser.parse_args()
    folder = Path(arguments.folder)
    if arguments.folder == "out" or (folder / "table-4.1").exists():
        needed = [folder / "table-4.1" / "estimates.csv", folder / "section-4" / "curves.csv"]
        if not all(path.exists() for path in needed):
            tell(f"computing {folder}: scripts/run.sh reproduce all")
            run("reproduce", "all", "--quiet", "--out", folder)
    path = Path(arguments.out or folder / "report.html")
    write_text(path, page_of(folder, arguments.case))
    print(path)


if __name__ == "__main__":
    main()
