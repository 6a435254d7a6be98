"""Tables in text files read back as the exporter meant them, or are refused with a sentence that
says what to do."""

import codecs
import gzip
import math
import os
from contextlib import suppress
from datetime import UTC, datetime

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.errors import InputError
from steelyard.experiment.streams.place import StreamPlace
from steelyard.experiment.streams.read_stream import read_stream
from steelyard.instruments import Tension
from steelyard.logs.formats import open_log
from steelyard.logs.log import NoRowsError, RowRange
from steelyard.logs.text import plain

NAN = math.nan
NOON = datetime(2024, 1, 31, 12, tzinfo=UTC).timestamp()


def written(folder, content, name="log.csv"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def everything(path):
    """Columns that hold numbers, and units, of a log."""
    with open_log(path) as log:
        columns = {}
        for name in log.names:
            with suppress(InputError):
                columns[name] = log.read([name])[name].tolist()
        return columns, dict(log.units)


def each_column(path):
    with open_log(path) as log:
        return {name: log.read([name])[name] for name in log.names}


def tabs(text):
    return text.replace("~", "\t")


def table(columns):
    """Columns of a literal: a name, then its numbers."""
    return {
        line.split()[0].replace("·", " "): [float(x) for x in line.split()[1:]]
        for line in columns.strip().splitlines()
    }


def example(name, content, columns, **units):
    return pytest.param(
        content, columns, {k.replace("·", " "): v for k, v in units.items()}, id=name
    )


PLAIN = {"t": [0, 0.5], "f1": [1.5, -2.5], "f2": [3, 4]}

LABVIEW = tabs("""\
LabVIEW Measurement~
Writer_Version~2
Reader_Version~2
Separator~Tab
Decimal_Separator~,
Multi_Headings~No
X_Columns~One
Time_Pref~Absolute
Operator~Eva
Date~2024/01/31
Time~12:00:00,9389457702636718750
***End_of_Header***~
~
Channels~2~~
Samples~3~3~
Date~2024/01/31~2024/01/31~
Time~12:00:00,9389457702636718750~12:00:00,9389457702636718750~
Y_Unit_Label~N~kN~
X_Dimension~Time~Time~
X0~0,0000000000000000E+0~0,0000000000000000E+0~
Delta_X~0,001000~0,001000~
***End_of_Header***~~~
X_Value~Force_0~Force_1~Comment
0,000000~1,500000~2,500000~start of motion
0,001000~1,250000~-2,125000
0,002000~1,125000~2,000000
""")

LABVIEW_WITHOUT_TIME = tabs("""\
LabVIEW Measurement
Writer_Version~2
Decimal_Separator~,
X_Columns~No
***End_of_Header***

Channels~2
Samples~100~100
Date~2024/07/22~2024/07/22
Time~17:18:18,938945770263671875~17:18:18,938945770263671875
X_Dimension~Time~Time
X0~0,0000000000000000E+0~0,0000000000000000E+0
Delta_X~1,000000~1,000000
***End_of_Header***
X_Value~Untitled~Untitled 1~Comment
~0,000000~0,055544
~0,125000~0,054323
~0,250000~0,055239
""")

SCOPE_HEADER = """\
Name~Scope Project_AutoSave_12_00_00~
File~D:\\autosave\\Scope Project.csv~
Starttime of export~133511904000000000~Mittwoch, 31. Januar 2024~12:00:00.000
Endtime of export~133511904020000000~Mittwoch, 31. Januar 2024~12:00:02.000

"""

SCOPE = tabs(
    SCOPE_HEADER
    + """\
Name~Force1~Force2~Name~ActPos
SymbolComment~~~SymbolComment~ position of the
 first axis, after (* scaling *)
Data-Type~REAL64~REAL64~Data-Type~INT32
SampleTime[ms]~1~1~SampleTime[ms]~1
VariableSize~8~8~VariableSize~4
SymbolBased~True~True~SymbolBased~True
IndexGroup~16448~16448~IndexGroup~16448
IndexOffset~608~616~IndexOffset~624
SymbolName~MAIN.fb.Force1~MAIN.fb.Force2~SymbolName~GVL.ActPos
NetID~172.16.8.205.1.1~172.16.8.205.1.1~NetID~172.16.8.205.1.1
Port~851~851~Port~501
Offset~0~0~Offset~0
ScaleFactor~1~1~ScaleFactor~1
BitMask~0xFFFFFFFFFFFFFFFF~0xFFFFFFFFFFFFFFFF~BitMask~0xFFFFFFFFFFFFFFFF
Unit~kN~(None)~Unit~mm
Unit ScaleFactor~1~1~Unit ScaleFactor~1
Unit Offset~0~0~Unit Offset~0

0~1,5~2~0~7
1~-2,5~3,25~1~8
2~3,75~4~2~9
EOF
"""
)

SLOWER_GROUP = tabs(
    SCOPE_HEADER.replace("Name", "Name")
    + "Name~Force1~Name~ActPos\nSampleTime[ms]~1~SampleTime[ms]~2\nOffset~0~Offset~0\n\n"
    + "0~1,5~0~7\n1~2,5~2~8\n2~3,5\n3~4,5\n4~5,5\n5~6,5\nEOF\n"
)

MOTIVE = """\
Format Version,1.23,Take Name,Take 1,Take Notes,,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,Capture Start Time,2024-01-31 12.00.00.500 PM,\
Total Frames in Take,2,Total Exported Frames,2,Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker
,Name,Cube,Cube,Cube,Cube,Cube,Cube,Cube,Cube,Cube:1,Cube:1,Cube:1
,ID,"3B0A","3B0A","3B0A","3B0A","3B0A","3B0A","3B0A","3B0A","3B0B","3B0B","3B0B"
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z
0,0.000000,0.1,0.2,0.3,0.9,100.5,200.5,300.5,0.25,1,2,3
1,0.010000,0.1,0.2,0.3,0.9,101.5,201.5,301.5,0.25,,,
"""

EXAMPLES = [
    example("commas", "t,f1,f2\n0,1.5,3\n0.5,-2.5,4\n", PLAIN),
    example("blanks after commas", "t, f1, f2\n0, 1.5, 3\n0.5, -2.5, 4\n", PLAIN),
    example("blanks before commas", "t ,f1 ,f2\n0 ,1.5 ,3\n0.5 ,-2.5 ,4 \n", PLAIN),
    example("semicolons", "t;f1;f2\n0;1.5;3\n0.5;-2.5;4\n", PLAIN),
    example("semicolons and decimal commas", "t;f1;f2\n0;1,5;3\n0,5;-2,5;4\n", PLAIN),
    example("two columns of decimal commas", "t;f1\n0,0;1,5\n0,5;-2,5\n", {"t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("tabs", "t\tf1\tf2\n0\t1.5\t3\n0.5\t-2.5\t4\n", PLAIN),
    example("tabs and decimal commas", "t\tf1\tf2\n0\t1,5\t3\n0,5\t-2,5\t4\n", PLAIN),
    example("empty cells between tabs", "t\tf1\tf2\n0\t\t3\n0.5\t2.5\t\n", {"t": [0, 0.5], "f1": [NAN, 2.5], "f2": [3, NAN]}),
    example("pipes", "t|f1|f2\n0|1.5|3\n0.5|-2.5|4\n", PLAIN),
    example("aligned by blanks", "   t    f1  f2\n 0.0   1.5   3\n 0.5  -2.5   4\n", PLAIN),
    example("aligned by blanks, ruled", "t      f1      f2\n---    ----    --\n0.0    1.5     3\n0.5   -2.5     4\n", PLAIN),
    example("aligned by blanks, long names", "Time   Force 1   Force 2\n0.0    1.5     3\n0.5   -2.5     4\n",
            {"Time": [0, 0.5], "Force 1": [1.5, -2.5], "Force 2": [3, 4]}),
    example("aligned by blanks, units behind names", "t [s] f1 [N] f2 [kN]\n0.0 1.5 3\n0.5 -2.5 4\n", PLAIN, t="s", f1="N", f2="kN"),
    example("quoted cells", '"t","f1","f2"\n"0","1.5","3"\n"0.5","-2.5","4"\n', PLAIN),
    example("quoted decimal commas between commas", 't,f1,f2\n"0","1,5","3"\n"0,5","-2,5","4"\n', PLAIN),
    example("separator for Excel", "sep=;\r\nt;f1;f2\r\n0;1,5;3\r\n0,5;-2,5;4\r\n", PLAIN),
    example("carriage returns and newlines", "t,f1,f2\r\n0,1.5,3\r\n0.5,-2.5,4\r\n", PLAIN),
    example("carriage returns", "t,f1,f2\r0,1.5,3\r0.5,-2.5,4\r", PLAIN),
    example("no newline at the end", "t,f1,f2\n0,1.5,3\n0.5,-2.5,4", PLAIN),
    example("separators at the end of every row", "t;f1;f2;\n0;1.5;3;\n0.5;-2.5;4;\n", PLAIN),
    example("separators at the end of rows but not of the header", "t;f1;f2\n0;1.5;3;\n0.5;-2.5;4;\n", PLAIN),
    example("blank lines", "\n\nt,f1,f2\n\n0,1.5,3\n\n  \n0.5,-2.5,4\n\n,,\n\n", PLAIN),
    example("empty rows of a spreadsheet", "t;f1;f2\r\n0;1,5;3\r\n;;\r\n0,5;-2,5;4\r\n;;\r\n;;\r\n", PLAIN),
    example("no header", "0,1.5,3\n0.5,-2.5,4\n", {"[0]": [0, 0.5], "[1]": [1.5, -2.5], "[2]": [3, 4]}),
    example("no header below a title", "measured on Monday\n0,1.5,3\n0.5,-2.5,4\n", {"[0]": [0, 0.5], "[1]": [1.5, -2.5], "[2]": [3, 4]}),
    example("a header of numbers", "t,1,2\n0,1.5,3\n0.5,-2.5,4\n", {"t": [0, 0.5], "1": [1.5, -2.5], "2": [3, 4]}),
    example("byte-order mark", codecs.BOM_UTF8 + b"t,f1,f2\n0,1.5,3\n0.5,-2.5,4\n", PLAIN),
    *(
        example(f"{name}, {end!r}", mark + f"t;f1 [µN];f2{end}0;1,5;3{end}0,5;-2,5;4{end}".encode(name), {"t": [0, 0.5], "f1": [1.5, -2.5], "f2": [3, 4]}, f1="µN")
        for name, mark in [("utf-16-le", codecs.BOM_UTF16_LE), ("utf-16-be", codecs.BOM_UTF16_BE), ("utf-16-le", b""), ("utf-16-be", b"")]
        for end in ("\n", "\r\n")
    ),
    example("Latin-1", "t;wx [°/s];ax (m/s²)\n0;1,5;3\n0,5;-2,5;4\n".encode("latin-1"), {"t": [0, 0.5], "wx": [1.5, -2.5], "ax": [3, 4]}, wx="°/s", ax="m/s²"),
    example("missing", "t,f1,f2\n0,NaN,3\n1,-,nan\n2,,N/A\n3,null,#N/A\n4,1.#QNAN,NA\n5,7,--\n", {"t": [0, 1, 2, 3, 4, 5], "f1": [NAN] * 5 + [7], "f2": [3] + [NAN] * 5}),
    example("numbers of all kinds", "t,f1\n0,+1.5\n1,.5\n2,2.\n3,1e3\n4,-1.5E-02\n5,1.5D+01\n6,00012\n", {"t": [0, 1, 2, 3, 4, 5, 6], "f1": [1.5, 0.5, 2, 1000, -0.015, 15, 12]}),
    example("text beside numbers", 't,status,f1,remark\n0,ok,1.5,"first, of all"\n0.5,ok,-2.5,\n', {"t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("text first", "remark;t;f1\nok;0;1,5\nnot so good, 5 of 7;0,5;-2,5\n", {"t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("text that is rare", "t,f1,remark\n" + "".join(f"{i},2,{'moved' if i == 0 else ''}\n" for i in range(9)), {"t": [*range(9)], "f1": [2] * 9}),
    # Units
    example("row of units", "t,f1,wx,ax\ns,kN,°/s,m/s²\n0,1.5,3,4\n", {"t": [0], "f1": [1.5], "wx": [3], "ax": [4]}, t="s", f1="kN", wx="°/s", ax="m/s²"),
    example("row of units in brackets", "t;f1;v\n[ms];[N];[V]\n0;1,5;3\n", {"t": [0], "f1": [1.5], "v": [3]}, t="ms", f1="N", v="V"),
    example("row of units in round brackets, one empty", "t\tf1\tf2\n(s)\t\t(daN)\n0\t1.5\t3\n", {"t": [0], "f1": [1.5], "f2": [3]}, t="s", f2="daN"),
    example("row of units that nobody knows", "t,f1,f2\nsecs.,Kp.,Kp.\n0,1.5,3\n", {"t": [0], "f1": [1.5], "f2": [3]}, t="secs.", f1="Kp.", f2="Kp."),
    example("labelled units", "# units: ms, kN, mm\nt,f1,x\n0,1.5,3\n", {"t": [0], "f1": [1.5], "x": [3]}, t="ms", f1="kN", x="mm"),
    example("units behind names", "t [ms],f1 [N],acc_x (g),wx [°/s],qw [-],x / mm,l1 in cm\n0,1,2,3,4,5,6\n",
            {"t": [0], "f1": [1], "acc_x": [2], "wx": [3], "qw": [4], "x": [5], "l1": [6]}, t="ms", f1="N", acc_x="g", wx="°/s", qw="-", x="mm", l1="cm"),
    example("unknown units", "t,f1 [furlong],speed (raw)\n0,1,2\n", {"t": [0], "f1": [1], "speed (raw)": [2]}, f1="furlong", **{"speed·(raw)": "raw"}),
    example("brackets that are no units", "t,data[3],f (left) [N],f (right) [N]\n0,1,2,3\n", {"t": [0], "data[3]": [1], "f (left)": [2], "f (right)": [3]}, **{"f·(left)": "N", "f·(right)": "N"}),
    example("units as endings", "time_us,force_kN,x_m,p_cm\n0,1,2,3\n", {"time_us": [0], "force_kN": [1], "x_m": [2], "p_cm": [3]}, time_us="us", force_kN="kN"),
    # Time
    example("ISO dates", "t,f1\n2024-01-31 12:00:00,1.5\n2024-01-31 12:00:00.25,2.5\n", {"t": [NOON, NOON + 0.25], "f1": [1.5, 2.5]}),
    example("ISO dates of a zone", "t,f1\n2024-01-31T14:00:00.000+02:00,1.5\n2024-01-31T14:00:00.250+02:00,2.5\n", {"t": [NOON, NOON + 0.25], "f1": [1.5, 2.5]}),
    example("ISO dates with Z", "t,f1\n2024-01-31T12:00:00Z,1.5\n2024-01-31T12:00:00.25Z,2.5\n", {"t": [NOON, NOON + 0.25], "f1": [1.5, 2.5]}),
    example("German dates", "Zeit;f1\n31.01.2024 12:00:00,000;1,5\n31.01.2024 12:00:00,250;2,5\n", {"Zeit": [NOON, NOON + 0.25], "f1": [1.5, 2.5]}),
    example("time of day", "Date,Time,f1\n2024-01-31,00:01:00.5,1.5\n2024-01-31,00:01:00.75,2.5\n", {"Time": [60.5, 60.75], "f1": [1.5, 2.5]}),
    # Exporters
    example("numpy.savetxt", "# t f1 f2\n0.000000000000000000e+00 1.500000000000000000e+00 3.000000000000000000e+00\n5.0e-01 -2.5e+00 4.0e+00\n", PLAIN),
    example("numpy.savetxt with commas, header with blanks", "# t f1 f2\n0.0,1.5,3.0\n0.5,-2.5,4\n", PLAIN),
    example("comments above", "% device: XY-7, serial 5\n% rate: 100\n%\n// by hand\nt,f1,f2\n0,1.5,3\n0.5,-2.5,4\n", PLAIN),
    example("comments in between", "t,f1,f2\n0,1.5,3\n# paused, then resumed\n0.5,-2.5,4\n", PLAIN),
    example("keys and values above", "Device: QuantumX\nSerial;4711\nRate;100\nChannels;3\n\nt;f1;f2\ns;N;N\n0;1,5;3\n0,5;-2,5;4\n", PLAIN, t="s", f1="N", f2="N"),
    example("PlotJuggler", "__time,/imu/linear_acceleration/x,/joint_states/effort[0]\n1700000000.5,1.5,\n1700000000.6,,3\n",
            {"__time": [1700000000.5, 1700000000.6], "/imu/linear_acceleration/x": [1.5, NAN], "/joint_states/effort[0]": [NAN, 3]}),
    example("rostopic echo -p", "%time,field.header.seq,field.header.frame_id,field.wrench.force.x\n1700000000500000000,1,ft,1.5\n1700000000510000000,2,ft,2.5\n",
            {"time": [1700000000500000000, 1700000000510000000], "field.header.seq": [1, 2], "field.wrench.force.x": [1.5, 2.5]}),
    example("Excel, German", "sep=;\r\nZeit [s];Kraft Süd [N];Temperatur [°C]\r\n0,00;1.234,5;20\r\n".replace("1.234", "1234").encode("cp1252"),
            {"Zeit": [0], "Kraft Süd": [1234.5], "Temperatur": [20]}, Zeit="s", Temperatur="°C", Kraft·Süd="N"),
    example("pandas", ",t,f1\n0,0.0,1.5\n1,0.5,-2.5\n", {"[0]": [0, 1], "t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("pandas, time as index", ",f1,f2\n2024-01-31 12:00:00,1.5,3\n2024-01-31 12:00:00.250000,-2.5,4\n", {"[0]": [NOON, NOON + 0.25], "f1": [1.5, -2.5], "f2": [3, 4]}),
    example("R write.csv", '"","t","f1"\n"1",0,1.5\n"2",0.5,-2.5\n', {"[0]": [1, 2], "t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("R write.table", '"t" "f1"\n"1" 0 1.5\n"2" 0.5 -2.5\n', {"[0]": [1, 2], "t": [0, 0.5], "f1": [1.5, -2.5]}),
    example("R write.csv2", '"t";"f1"\n0;1,5\n0,5;NA\n', {"t": [0, 0.5], "f1": [1.5, NAN]}),
    example("MATLAB writetable", "t,f_1,f_2\n0,1.5,NaN\n0.5,-2.5,4\n", {"t": [0, 0.5], "f_1": [1.5, -2.5], "f_2": [NAN, 4]}),
    example("MATLAB writetimetable", "Time,f_1\n0 sec,1.5\n0.25 sec,-2.5\n", {"Time": [0, 0.25], "f_1": [1.5, -2.5]}),
    example("LabVIEW", LABVIEW, {"X_Value": [0, 0.001, 0.002], "Force_0": [1.5, 1.25, 1.125], "Force_1": [2.5, -2.125, 2]}, Force_0="N", Force_1="kN"),
    example("LabVIEW without times", LABVIEW_WITHOUT_TIME, {"Untitled": [0, 0.125, 0.25], "Untitled 1": [0.055544, 0.054323, 0.055239]}),
    example("TwinCAT Scope", SCOPE, {"t": [0, 1, 2], "Force1": [1.5, -2.5, 3.75], "Force2": [2, 3.25, 4], "t[1]": [0, 1, 2], "ActPos": [7, 8, 9]},
            **{"t": "ms", "t[1]": "ms", "Force1": "kN", "ActPos": "mm"}),
    example("TwinCAT Scope, names only", "Name,Force1,Name,ActPos\n0,1.5,0,7\n1,-2.5,1,8\n", {"t": [0, 1], "Force1": [1.5, -2.5], "t[1]": [0, 1], "ActPos": [7, 8]}, **{"t": "ms", "t[1]": "ms"}),
    example("TwinCAT Scope, full time stamps", "Name,Force1\n133511904000000000,1.5\n133511904000010000,-2.5\n", {"t": [133511904000000000, 133511904000010000], "Force1": [1.5, -2.5]}, t="100ns"),
    example("TwinCAT Scope, a slower group", SLOWER_GROUP, {"t": [0, 1, 2, 3, 4, 5], "Force1": [1.5, 2.5, 3.5, 4.5, 5.5, 6.5], "t[1]": [0, 2] + [NAN] * 4, "ActPos": [7, 8] + [NAN] * 4}, **{"t": "ms", "t[1]": "ms"}),
    example("CoDeSys sampling trace", "BODAS Trace\nD:\\PROJECTS\\CRANE.PRO\nCycle PLC_PRG.FORCE PLC_PRG.SPEED\n0 2 1\n1 3 1\n", {"Cycle": [0, 1], "PLC_PRG.FORCE": [2, 3], "PLC_PRG.SPEED": [1, 1]}),
    example("Siemens data log", "Record,Date,UTC Time,Force\n1,1/31/2024,12:00:00,1.5\n2,1/31/2024,12:00:01,2.5\n//END,,,\n", {"Record": [1, 2], "UTC Time": [43200, 43201], "Force": [1.5, 2.5]}),
    example("Panasonic trace", "#made by hand\nDate,Time,Interval,DT0,DT1\n-,-,ms,N,N\n24/01/31,12:00:00,0,1,2\n24/01/31,12:00:00,10,3,4\n",
            {"Time": [43200, 43200], "Interval": [0, 10], "DT0": [1, 3], "DT1": [2, 4]}, Date="-", Interval="ms", DT0="N", DT1="N"),
    example("Vicon", "Trajectories\n100\n,,Robot:A,,,Robot:B,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n1,0,1.5,2,3,4,5,6\n2,0,1,,3,4,5,6\n",
            {"Frame": [1, 2], "Sub Frame": [0, 0], "Robot:A.X": [1.5, 1], "Robot:A.Y": [2, NAN], "Robot:A.Z": [3, 3], "Robot:B.X": [4, 4], "Robot:B.Y": [5, 5], "Robot:B.Z": [6, 6]},
            **{f"Robot:{body}.{axis}": "mm" for body in "AB" for axis in "XYZ"}),
    example("Vicon, one marker", "Trajectories\n100\n,,Robot:A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1.5,2,3\n", {"Frame": [1], "Sub Frame": [0], "X": [1.5], "Y": [2], "Z": [3]}, X="mm", Y="mm", Z="mm"),
    example("Motive", MOTIVE,
            {"Frame": [0, 1], "Time": [0, 0.01], **{f"Cube.Rotation.{a}": [v, v] for a, v in zip("XYZW", (0.1, 0.2, 0.3, 0.9), strict=True)},
             **{f"Cube.Position.{a}": [100.5 + 100 * i, 101.5 + 100 * i] for i, a in enumerate("XYZ")}, "Cube.Mean Marker Error": [0.25, 0.25],
             **{f"Cube:1.Position.{a}": [i + 1, NAN] for i, a in enumerate("XYZ")}},
            **{"Time": "Seconds", **{f"{body}.Position.{a}": "Millimeters" for body in ("Cube", "Cube:1") for a in "XYZ"}}),
    example("laser tracker, names first", "Name;X [mm];Y [mm]\nA::p1;1,5;2\nA::p2;1,6;2\n", {"X": [1.5, 1.6], "Y": [2, 2]}, X="mm", Y="mm"),
    example("laser tracker", "Collection::Group::Point;X [mm];Y [mm];Z [mm];Timestamp\nA::Main::p1;1,5;2;3;31.01.2024 12:00:00,000\nA::Main::p2;1,6;2;3;31.01.2024 12:00:00,001\n",
            {"X": [1.5, 1.6], "Y": [2, 2], "Z": [3, 3], "Timestamp": [NOON, NOON + 0.001]}, X="mm", Y="mm", Z="mm"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "columns", "units"), EXAMPLES)
def test_every_exporter_is_understood(tmp_path, content, columns, units):
    found, stated = everything(written(tmp_path, content))
    assert found.keys() == columns.keys()
    for name, values in columns.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    assert stated == units


# Names and places


def test_a_column_may_be_called_as_the_file_spells_it(tmp_path):
    with open_log(written(tmp_path, "t [s],f1 [kN]\n0,1\n")) as log:
        assert log.spellings == {"t [s]": "t", "f1 [kN]": "f1"}


LONG_HEADER = "".join(f"# line {i}\n" for i in range(40)) + "t,f1\n\ns,N\n"


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("t,f1\n0,1\n1,high\n2,3\n", 3),
        ("t,f1\n0,high\n1,2\n2,3\n", 2),
        ("0,1\n1,high\n2,3\n", 2),
        ("t,f1\r\n0,1\r\n\r\n1,high\r\n2,3\r\n", 4),
        ("t,f1\r0,1\r\r1,high\r2,3\r", 4),
        (LONG_HEADER + "0,1\n\n# pause\n1,high\n2,3\n", 47),
        ("sep=;\nt;f1\n0;1,5\n1;high\n2;3\n", 4),
        ("t  f1\n0  1\n1  high\n2  3\n", 3),
        ('"t","f1"\n"0","1"\n"1","high"\n"2","3"\n', 3),
        pytest.param(
            "t,f1\n" + "0,1.5\n" * 1_500_000 + "0,high\n" + "0,1.5\n" * 10,
            1_500_002,
            marks=pytest.mark.integration,
        ),
        pytest.param(
            "t,f1\n"
            + "0,1.5\n" * 1_000_000
            + "\n\n"
            + "0,1.5\n" * 500_000
            + "0,high\n"
            + "0,1.5\n" * 10,
            1_500_004,
            marks=pytest.mark.integration,
        ),
    ],
    ids=lambda value: "" if isinstance(value, str) else None,
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_the_line_of_a_wrong_cell_is_that_of_the_file(tmp_path, content, line, encoding):
    path = written(tmp_path, content.encode(encoding))
    with (
        open_log(path) as log,
        pytest.raises(InputError, match=rf"log\.csv:{line}: column '(f1|\[1\])': .*'high'"),
    ):
        log.read([log.names[1]])


def test_the_line_of_a_row_is_that_of_the_file(tmp_path):
    with open_log(
        written(tmp_path, "# by hand\nt,f1\ns,N\n0,1\n\n1,1e40\n\n\n2,3\n3,inf\n")
    ) as log:
        assert [log.place(i).rsplit(":", 1)[1] for i in range(4)] == ["4", "6", "9", "10"]
        part = RowRange("t", 1.5, 9.0)
        assert [log.place(i, part).rsplit(":", 1)[1] for i in range(2)] == ["9", "10"]
        with pytest.raises(InputError, match=r"log\.csv:6: column 'f1': .*found 1e\+40"):
            log.read(["t", "f1"])
        with pytest.raises(InputError, match=r"log\.csv:10: column 'f1': .*found infinity"):
            log.read(["t", "f1"], part)


@pytest.mark.integration
def test_a_part_is_what_all_of_it_has_there(tmp_path):
    rng = np.random.default_rng(0)
    time = np.arange(200_000) * 1e-3
    frame = pl.DataFrame({"t": time, **{f"f{i}": rng.normal(size=len(time)) for i in range(4)}})
    frame.write_csv(tmp_path / "log.csv")
    with open_log(tmp_path / "log.csv") as log:
        part = log.read(["f2", "t"], RowRange("t", 50.0, 60.0))
        inside = (time >= 50.0) & (time <= 60.0)
        np.testing.assert_array_equal(part["t"], time[inside])
        np.testing.assert_array_equal(part["f2"], frame["f2"].to_numpy()[inside])
        np.testing.assert_array_equal(log.read(["f2"], RowRange("t", 50.0, 60.0))["f2"], part["f2"])
        np.testing.assert_array_equal(log.read(["f2"], rows=7)["f2"], frame["f2"].to_numpy()[:7])
        with pytest.raises(NoRowsError, match="correct the window"):
            log.read(["t"], RowRange("t", 500.0, 600.0))


def rows_of(form, n=400, first=0):
    return "".join(form.format(t=i / 8, a=i * 0.37 - 20, b=i) for i in range(first, n))


COMMAS = "{t},{a:.3f},{b}\n"

IN_PIECES = {
    "commas": "t,f1,f2\n" + rows_of(COMMAS),
    "blanks": "t f1 f2\n" + rows_of("{t}   {a:.3f}  {b}\n"),
    "quotes": '"t","f1","f2"\n' + rows_of('"{t}","{a:.3f}","{b}"\n'),
    "quotes that matter": "t,f1,f2,note\n" + rows_of('{t},{a:.3f},{b},"one, or ""two"""\n'),
    "decimal commas and dates": (
        "t;f1;f2\n"
        + rows_of("31.01.2024 12:00:0{t:.3f};{a:.3f};{b}\n", 70)
        .replace(".", ",")
        .replace("31,01,", "31.01.")
    ),
    "missing": (
        "t,f1,f2\n"
        + rows_of(COMMAS, 100)
        + rows_of("{t},NULL,{b}\n", 200, 100)
        + rows_of(COMMAS, 300, 200)
    ),
    "empty lines and comments": (
        "t,f1,f2\n"
        + "".join(rows_of(COMMAS, i + 7, i) + "\n# note, here\n,,\n" for i in range(0, 280, 7))
    ),
    "short rows": (
        "t,f1,f2\n"
        + rows_of(COMMAS, 100)
        + rows_of("{t},{a:.3f}\n", 200, 100)
        + rows_of("{t}\n", 300, 200)
    ),
    "a short row": "t,f1,f2\n" + rows_of(COMMAS, 150) + "19,7\n" + rows_of(COMMAS, 300, 151),
    "a short row at the end": "t,f1,f2\n" + rows_of(COMMAS, 299) + "40,7",
    "a wrong cell": "t,f1,f2\n\n" + rows_of(COMMAS, 200) + "25,x,1\n" + rows_of(COMMAS, 300, 201),
    "an infinite cell": (
        "t,f1,f2\n\n" + rows_of(COMMAS, 200) + "\n25,inf,1\n" + rows_of(COMMAS, 300, 201)
    ),
}


def outcome(path, part):
    try:
        with open_log(path) as log:
            return log.read(list(log.names[:3]), part).cells, [log.place(i, part) for i in (0, 5)]
    except InputError as error:
        return str(error), []


@pytest.mark.integration
@pytest.mark.parametrize("content", IN_PIECES.values(), ids=IN_PIECES.keys())
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "gzip"])
@pytest.mark.parametrize("part", [None, RowRange("t", 20.0, 30.0)], ids=["all", "part"])
def test_pieces_make_no_difference(tmp_path, monkeypatch, content, encoding, part):
    packed = encoding == "gzip"
    made = gzip.compress(content.encode()) if packed else content.encode(encoding)
    path = written(tmp_path, made, "log.csv.gz" if packed else "log.csv")
    whole, places = outcome(path, part)
    for size in (509, 3001):
        monkeypatch.setattr(plain, "_PIECE", size)
        monkeypatch.setattr(plain, "_PACKED", 100)
        piecewise, places_of_pieces = outcome(path, part)
        np.testing.assert_array_equal(piecewise, whole)
        assert places_of_pieces == places


# What is refused


@pytest.mark.parametrize(
    ("content", "pattern"),
    [
        ("t,f1,f2\n0,1,2\n1,2\n2,3,4\n", r"log\.csv:3: expected 3 cells as in other rows, found 2"),
        ("t,f1,f2\n0,1,2\n1,2,3\n2,3", r"log\.csv:4: expected 3 cells as in other rows, found 2"),
        (
            "t,f1,f2\n0,1,2\n1,2\n,3\n2,3,4\n",
            r"log\.csv:3: expected 3 cells as in other rows, found 2",
        ),
        (
            "t,f1,f2\n0,1,2\n1,2,3,4\n2,3,4\n",
            r"log\.csv:3: expected 3 cells as in the header, found 4",
        ),
        (
            "t,f1,f2\n0,1,2,3\n1,2,3\n2,3,4\n",
            r"log\.csv:2: expected 3 cells as in the header, found 4",
        ),
        ("t,f1\n0,1\n1,2,5\n2,3\n", r"log\.csv:3: expected 2 cells"),
        ("t,f1\n0,1\n1,'2'\n", r"log\.csv:3: column 'f1': expected a number, found ''2''"),
        (
            "t;f1\n0;1,5\n1;1.234,5\n",
            r"log\.csv:3: column 'f1': expected a number, found '1\.234,5'",
        ),
        ("t;f1\n0;1,5\n1;1.234\n", r"log\.csv:3: column 'f1': expected a number, found '1\.234'"),
        ("t;f1\n0;1.5\n1;2.5\n2;1,5\n", r"log\.csv:4: column 'f1': expected a number, found '1,5'"),
        (
            't,f1\n0,1.5\n1,"1,234.5"\n',
            r"log\.csv:3: column 'f1': expected a number, found '1,234\.5'",
        ),
        (
            't,f1\n0,1.5\n1,"2"3\n',
            r"log\.csv:3: column 'f1': expected a number|log\.csv.*: expected .*quotation",
        ),
        ('t,f1\n0,1.5\n1,2"3"\n', r"log\.csv:3: column 'f1': expected a number"),
        ("t,f1\n0,1.5\n1,1 000\n", r"log\.csv:3: column 'f1': expected a number, found '1 000'"),
        ("t,f1\n0,1.5\n1,0x1F\n", r"log\.csv:3: column 'f1': expected a number, found '0x1F'"),
        ("t,f1\n0,1.5\n1,1_000\n", r"log\.csv:3: column 'f1': expected a number, found '1_000'"),
        ("t,f1\n0,1.5\n1,1.5N\n", r"log\.csv:3: column 'f1': expected a number, found '1\.5N'"),
        ("t,f1\n0,1.5\n1,\u0661\n", r"log\.csv:3: column 'f1': expected a number"),
        ("t,f1\n0,1.5\n1,2\0\0\n", r"log\.csv: expected text"),
        (
            "t,f1\n" + "0,1.5\n" * 1000 + "1,2\0\0\n",
            r"log\.csv:1002: column 'f1': expected a number",
        ),
        (
            "f1,t\n1,2024-01-31 12:00:00\n1,2024-02-31 12:00:00\n",
            r"log\.csv:3: column 't': expected an instant",
        ),
        (
            "f1,t\n1,2024-01-31 12:00:00\n1,12:00:01\n",
            r"log\.csv:3: column 't': expected an instant",
        ),
        (
            "f1,t\n1,01/31/2024 12:00:00\n1,01/31/2024 12:00:01\n",
            r"log\.csv:2: column 't': expected a number",
        ),
        ("t,f1,f2\n0 1 2\n1 2 3\n", r"log\.csv:1: expected 3 names, .*found 1"),
        (
            "t;f1,f2,f3\n0,1,2,3\n1,2,3,4\n",
            r"log\.csv:1: expected 4 names, one for each cell of the rows below, found 3",
        ),
        ("t,force, left,f2\n0,1,2\n1,2,3\n", r"log\.csv:1: expected 3 names, .*found 4"),
        (
            SCOPE.replace("0~1,5".replace("~", "\t"), "0\thigh"),
            r"log\.csv:25: column 'Force1': expected a number, found 'high'",
        ),
        (
            SCOPE.replace("1~-2,5".replace("~", "\t"), "1\thigh"),
            r"log\.csv:26: column 'Force1': expected a number, found 'high'",
        ),
        ("t,t\n0,1\n", r"log\.csv: expected columns of different names, found 't' twice"),
    ],
)
def test_what_is_doubtful_is_refused(tmp_path, content, pattern):
    path = written(tmp_path, content)
    with pytest.raises(InputError, match=pattern):
        each_column(path)


def test_times_of_another_group_are_no_times_of_a_column(tmp_path):
    with open_log(written(tmp_path, SCOPE)) as log:
        np.testing.assert_array_equal(log.read(["Force1", "ActPos", "t"])["ActPos"], [7, 8, 9])
    with open_log(written(tmp_path, SLOWER_GROUP)) as log:
        np.testing.assert_array_equal(log.read(["ActPos", "t[1]"])["t[1]"][:2], [0, 2])
        with pytest.raises(
            InputError,
            match=(
                r"log\.csv:11: column 'ActPos': expected a sample at the time 1 of column 't',"
                r" found one at 2; .*'t\[1\]' as t"
            ),
        ):
            log.read(["Force1", "ActPos", "t"])


# Any table in any dialect

NUMBERS = (
    st.floats(-1e12, 1e12)
    | st.integers(-(10**9), 10**9).map(float)
    | st.floats(-1, 1).map(lambda x: x * 1e-9)
)
FORMS = [repr, "{:.6f}".format, "{:+.3e}".format, "{:.12g}".format]
MISSING_CELLS = ["NaN", "nan", "NULL", "N/A", "-", "#N/A"]


@st.composite
def files(draw):
    """Bytes of a table, the names of its columns, and the numbers in it, shape (n, k)."""
    separator = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    decimal = draw(st.sampled_from([".", ","])) if separator != "," else "."
    n, k = draw(st.integers(2, 8)), draw(st.integers(2, 5))
    form = draw(st.sampled_from(FORMS))
    gaps = draw(st.sampled_from(MISSING_CELLS + ([""] if separator != " " else [])))
    numbers = draw(st.lists(st.lists(NUMBERS, min_size=k, max_size=k), min_size=n, max_size=n))
    lost = draw(st.sets(st.tuples(st.integers(1, n - 1), st.integers(1, k - 1)), max_size=3))
    cells = [
        [gaps if (i, j) in lost else form(x) for j, x in enumerate(row)]
        for i, row in enumerate(numbers)
    ]
    values = np.array(
        [[NAN if (i, j) in lost else float(cells[i][j]) for j in range(k)] for i in range(n)]
    )
    names = [
        "t",
        *draw(
            st.lists(
                st.text("abcxyz_", min_size=2, max_size=6),
                min_size=k - 1,
                max_size=k - 1,
                unique=True,
            )
        ),
    ]
    quote = draw(st.sampled_from(["", '"']))
    blanks = draw(st.sampled_from(["", " "]))
    headed = draw(st.booleans())
    lines = [[f"{quote}{cell.replace('.', decimal)}{quote}" for cell in row] for row in cells]
    above = [[f"{quote}{name}{quote}" for name in names]] if headed else []
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    last = draw(st.sampled_from(["", separator])) if separator != " " else ""
    lines = [(separator + blanks).join(row) + last for row in above + lines]
    if draw(st.booleans()):
        lines.insert(draw(st.integers(0, len(lines))), "")
    if headed and draw(st.booleans()):
        lines.insert(0, "# made by hand")
    text = end.join(lines) + draw(st.sampled_from(["", end]))
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    packed = draw(st.booleans())
    content = text.encode(encoding)
    return (
        (gzip.compress(content, mtime=0) if packed else content),
        packed,
        names if headed else [f"[{j}]" for j in range(k)],
        values,
    )


EASY = settings(
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.mark.slow
@settings(EASY, max_examples=150)
@given(file=files())
def test_any_table_in_any_dialect_comes_back(tmp_path, file):
    content, packed, names, values = file
    with open_log(written(tmp_path, content, "log.csv.gz" if packed else "log.csv")) as log:
        assert list(log.names[: len(names)]) == names
        assert all(name == f"[{j}]" for j, name in enumerate(log.names) if j >= len(names))
        for j, name in enumerate(names):
            if np.isnan(values[:, j]).all():
                with pytest.raises(InputError, match="not a single one"):
                    log.read([name])
            else:
                np.testing.assert_array_equal(log.read([name])[name], values[:, j])


@pytest.mark.slow
@pytest.mark.integration
@settings(EASY, max_examples=150)
@given(file=files(), data=st.data())
def test_a_damaged_table_gives_numbers_or_a_sentence(tmp_path, file, data):
    content, packed, _, _ = file
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged)))
        removed = data.draw(st.sampled_from([0, 1, 1, 5, 40]))
        damaged[at : at + removed] = data.draw(
            st.binary(max_size=4) | st.sampled_from([b'"', b"\n", b";", b",", b"\0", b"#", b"-"])
        )
    with suppress(InputError):
        everything(written(tmp_path, bytes(damaged), "log.csv.gz" if packed else "log.csv"))


@pytest.mark.slow
@settings(EASY, max_examples=200)
@given(data=st.data())
def test_a_wrong_character_in_one_row_leaves_no_other_row_wrong(tmp_path, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 9)))
    values = rng.normal(size=(12, 4)).round(3)
    text = "t;f1;f2;f3\n" + "".join(";".join(f"{x:.3f}" for x in row) + "\n" for row in values)
    text = data.draw(
        st.sampled_from(
            [
                text,
                text.replace(";", ","),
                text.replace(";", "\t"),
                text.replace(".", ","),
                text.replace(";", "  "),
            ]
        )
    )
    at = data.draw(st.integers(text.index("\n") + 1, len(text) - 2))
    wrong = data.draw(st.sampled_from(list(';,\t .|"#%-+eE0aN\n\r\0')))
    row = text.count("\n", 0, at) - 1
    path = written(tmp_path, text[:at] + wrong + text[at + 1 :])
    names = ["t", "f1", "f2", "f3"]
    try:
        with open_log(path) as log:
            if not {*names} <= {*log.names}:
                return
            found = np.column_stack([*log.read(names).values()])
    except InputError:
        return
    others = np.arange(len(values)) != row
    assert len(found) == len(values)
    np.testing.assert_array_equal(found[others], values[others])


# From the log to the stream


def tension(path, span=None, **place):
    return read_stream(
        StreamPlace(path, **place), Tension(kind="tension"), 2, static=False, span=span
    )


TIMES = np.arange(12) * 0.25


def forces(header, time=TIMES):
    return header + "".join(f"{t:g},{i + 1},{i + 0.5}\n" for i, t in enumerate(time))


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("t,f1,f2\n", (1, 1)),
        ("t,f1,f2\ns,N,kN\n", (1, 1000)),
        ("t [s],f1 [daN],f2 (N)\n", (10, 1)),
        ("t,f1 [kg],f2 [lbs]\n", (9.80665, 4.4482216152605)),
    ],
)
def test_units_that_a_file_states_are_honoured(tmp_path, header, scale):
    stream = tension(written(tmp_path, forces(header)))
    np.testing.assert_array_equal(stream.time, TIMES)
    expected = np.column_stack([np.arange(12) + 1, np.arange(12) + 0.5]) * scale
    np.testing.assert_allclose(stream.values["tension"], expected, rtol=1e-14)


@pytest.mark.parametrize("unit", ["furlong", "V", "m", "mil", "raw"])
def test_units_that_nobody_knows_are_not_guessed(tmp_path, unit):
    path = written(tmp_path, forces(f"t,f1 [N],f2 [{unit}]\n"))
    with pytest.raises(
        InputError,
        match=(
            rf"unit of column 'f2': expected one of N, .*found '{unit}'; the log says so itself;"
            r" .*'units'"
        ),
    ):
        tension(path)
    stream = tension(path, units={"f2": "kN"})
    np.testing.assert_allclose(stream.values["tension"][:, 1], (np.arange(12) + 0.5) * 1000)


def test_columns_and_units_may_be_stated_as_the_file_spells_them(tmp_path):
    path = written(tmp_path, forces("Time (s),Force A [?],Force B [N]\n"))
    columns = {"t": "Time (s)", "f1": "Force A [?]", "f2": "Force B"}
    stream = tension(path, columns=columns, units={"Force A [?]": "kN"})
    np.testing.assert_allclose(stream.values["tension"][1], [2000, 1.5])


def test_times_of_the_exporter_are_seconds(tmp_path):
    scope = written(
        tmp_path,
        SCOPE.replace("ActPos", "f1")
        .replace("Force2", "f2")
        .replace("MAIN.fb.f2", "")
        .replace("(None)", "N")
        .replace("mm", "kN"),
    )
    stream = tension(scope)
    np.testing.assert_allclose(stream.time, [0, 1e-3, 2e-3])
    np.testing.assert_allclose(stream.values["tension"], [[7000, 2], [8000, 3.25], [9000, 4]])


def test_a_window_is_part_of_the_whole(tmp_path):
    path = written(tmp_path, forces("t [ms],f1,f2\n", TIMES * 1e3))
    whole, part = tension(path), tension(path, span=(0.5, 1.25))
    np.testing.assert_array_equal(part.time, [0.5, 0.75, 1.0, 1.25])
    np.testing.assert_array_equal(part.values["tension"], whole.values["tension"][2:6])


# What is made to do harm

ROW = "0,1,2\n"


def gzipped(*parts, level=6):
    return gzip.compress(b"".join(parts), level, mtime=0)


HOSTILE = {
    "a bomb of rows": lambda: gzipped(b"t,f1,f2\n", b"0,0,0\n" * 20_000_000, level=9),
    "a bomb without a newline": lambda: gzipped(b"0," * 50_000_000, level=1),
    "a bomb of newlines": lambda: gzipped(b"t,f1,f2\n", b"\n" * 80_000_000, level=1),
    "a bomb of comments": lambda: gzipped(b"t,f1,f2\n0,1,2\n", b"# x\n" * 20_000_000, level=1),
    "many empty members": lambda: gzip.compress(b"", mtime=0) * 200_000 + gzipped(ROW.encode()),
    "packed twice": lambda: gzip.compress(gzipped(ROW.encode() * 100)),
    "cut off": lambda: gzipped(np.random.default_rng(0).bytes(1000).hex().encode())[:-9],
    "nothing but a mark": lambda: b"\x1f\x8b",
    "100000 columns": lambda: (",".join(f"c{i}" for i in range(100_000)) + "\n" + ("0," * 99_999 + "0\n") * 5).encode(),
    "a header of 6 MB": lambda: ("n" * 600 + ",").encode() * 10_000 + b"\n" + ROW.encode(),
    "a line of 100 MB": lambda: b"0," * 50_000_000,
    "bytes that are no text": lambda: bytes(range(256)) * 1000,
    "NUL bytes": lambda: b"\0" * 10_000_000,
    "NUL bytes behind a recording": lambda: b"t,f1,f2\n" + ROW.encode() * 5000 + b"\0" * 5000,
    "quotation marks that never close": lambda: b"t,f1,f2\n" + b'"0,1,2\n' * 100_000,
    "half a character of UTF-16": lambda: codecs.BOM_UTF16_LE + "t,f1,f2\n0,1,2\n".encode("utf-16-le") + b"\x00\xd8" * 9,
    "digits without end": lambda: b"t,f1,f2\n" + b"1" * 3_000_000 + b",1,2\n",
    "an empty file": lambda: b"",
    "empty lines": lambda: b"\n" * 3_000_000,
    "lines of separators": lambda: b"t,f1,f2\n" + b",,\n" * 1_000_000,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE.keys())
def test_harm_is_refused(tmp_path, content):
    made = content()
    path = written(tmp_path, made, "log.csv.gz" if made.startswith(b"\x1f\x8b") else "log.csv")
    with pytest.raises(InputError, match=r"log\.csv.*: expected .*found ") as caught:
        tension(path)
    assert len(str(caught.value)) < 600


@pytest.mark.integration
def test_many_empty_lines_are_nothing(tmp_path):
    content = forces("\n" * 1_000_000 + "t,f1,f2\n" + "\n" * 1_000_000)
    assert len(tension(written(tmp_path, content))) == 12


def test_names_may_be_long_and_full_of_signs(tmp_path):
    content = (
        "t,f1,f2,\x1b[31mred\x07,\u202e,',"
        + "n" * 1_000_000
        + "\n"
        + "".join(f"{t},1,2,3,4,5,6\n" for t in TIMES)
    )
    assert len(tension(written(tmp_path, content))) == 12


@pytest.mark.integration
def test_ten_thousand_columns_are_read(tmp_path):
    names = ",".join(["t", "f1", "f2", *(f"c{i}" for i in range(9_997))])
    content = names + "\n" + "".join(f"{t:g}," + ",".join(["1"] * 9_999) + "\n" for t in TIMES)
    assert len(tension(written(tmp_path, content))) == 12


@pytest.mark.parametrize("kind", ["pipe", "device", "link to itself", "gone"])
def test_what_is_no_file_is_refused(tmp_path, kind):
    path = tmp_path / "log.csv"
    {"pipe": lambda: os.mkfifo(path), "device": lambda: path.symlink_to("/dev/zero"), "link to itself": lambda: path.symlink_to(path), "gone": lambda: None}[kind]()  # fmt: skip
    with pytest.raises(InputError, match=r"log\.csv: expected a log, found "):
        tension(path)


def test_a_file_that_vanishes_is_refused(tmp_path):
    path = written(tmp_path, "t,f1\n0,1\n")
    with open_log(path) as log:
        path.unlink()
        with pytest.raises(
            InputError, match=r"log\.csv: expected a file that can be read, found 'No such file"
        ):
            log.read(["t"])
