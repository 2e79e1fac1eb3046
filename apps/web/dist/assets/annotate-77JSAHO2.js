import"./chunk-VSDYETHS.js";import{O as e,y as t}from"./chunk-ZJKHKGPO.js";function i(){return t(e,{title:"Annotate",text:"This page is being built."})}export{i as Annotate};
