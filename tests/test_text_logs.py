"""Tables in text files read back as the exporter meant them, or are refused with a sentence that says what to do."""

import codecs
import math
from datetime import UTC, datetime

import numpy as np
import pytest

from steelyard.errors import InputError
from steelyard.logs.formats import open_log

NAN = math.nan
NOON = datetime(2024, 1, 31, 12, tzinfo=UTC).timestamp()


def written(folder, content, name="log.csv"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def everything(path):
    """Columns and units of a log; columns without a name of their own and columns of text are left out."""
    with open_log(path) as log:
        columns = {}
        for name in log.names:
            try:
                columns[name] = log.read([name])[name].tolist()
            except InputError:
                continue
        return columns, dict(log.units)


def tabs(text):
    return text.replace("~", "\t")


def table(columns):
    """Columns of a literal: a name, then its numbers."""
    return {line.split()[0].replace("·", " "): [float(x) for x in line.split()[1:]] for line in columns.strip().splitlines()}


def example(name, content, columns, **units):
    return pytest.param(content, columns, {k.replace("·", " "): v for k, v in units.items()}, id=name)


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
