import{a,b,c}from"./chunk-CE6T4L3R.js";import"./chunk-WNKUAGU2.js";import"./chunk-I36ENHDM.js";export{c as Live,b as LiveFigures,a as WALL};
